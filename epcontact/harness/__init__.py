"""From case files to a verdict.

case, schema      the tables of a case file, checked, as a Case at one size
methods           METHODS: every way to answer a scene, including a user's own
quantities        QUANTITIES: every scalar that a gate can read (`measurements` computes some)
gates             comparisons with a band (`statistics`, `distances`)
run, store, pool  cases to results, over processes or any executor, kept on disk (`solve` is one
                  task, `memory` its estimate, `cluster` an executor on Dask)
sweep, axes       a case at many points
verdict           `verify`, the main job, and the Verdict that verdict.json holds
crosscheck        the parts of the difference between finite and boundary elements
                  (`model_difference`: J2 flow against a pressure cap)
peers             ContactMechanics and tamaas as methods
pytest_plugin     gates as tests of pytest (`pytest_cases` has the tests themselves)
pictures          the charts of a case
citations         the papers and the software that a case rests on
"""
