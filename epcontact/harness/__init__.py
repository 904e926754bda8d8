"""The way from case files to a verdict; each room imports only from those above it.

processes         processes that call functions for this one, and executors that spread calls
preload           what processes are forked with
gates             comparisons with a band, intervals of ensembles, distances
methods           METHODS: every way to answer a scene, including a user's own
quantities        QUANTITIES: every figure that a gate can read
case_files        the tables of a case file, checked, as a Case at one size
answers           cases to results, over processes or any executor, kept on disk
crosscheck        the parts of the difference between finite and boundary elements
sweep             a case at many points
verdict           `verify`, the main job, and the Verdict that verdict.json holds
pytest_plugin     gates as tests of pytest
cluster           an executor on Dask, for `--executor`
"""
