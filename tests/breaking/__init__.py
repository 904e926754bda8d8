"""Deliberate faults: each must turn a gate red or make a test fail.

`table.tsv` lists the faults.  In the folder of the tests, `python -m breaking` prints
what sees them, and `python -m breaking --check` those that no longer fit the code.
"""
