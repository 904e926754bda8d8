"""The way of a case from its file to a verdict.

    cases = load_cases(...)                        # case_files
    for case, results in solve_cases(cases, run):  # solving
        judge_case(case, results)                  # verdict

`verdict.verification.verify` is this loop.  Each part imports only from those above it:

workers           processes that call functions; calls spread over an executor
gates             comparisons with a band, intervals of ensembles, distances
quantities        QUANTITIES: every quantity that a gate can read
methods           METHODS: every way to solve a scene, including a user's own
case_files        the tables of a case file, checked, as a Case at one size
solving           tasks, what is measured at each load, results in memory and on disk
sweep             a case at many points
verdict           `verify`, the main job, and the Verdict that verdict.json holds
pytest_plugin     gates as tests of pytest
cluster           an executor on Dask, for `--executor`
"""
