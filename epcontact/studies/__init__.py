"""Studies: charts of accuracy against cost, and of the theory against numerics.

A study is a function with the decorator `study` of `frame`, in one of the modules
below.  The times in a chart come from one run on one machine, so that only their ratios
are comparable.
"""

# Importing a module of the first block registers its studies.
from epcontact.studies import (  # noqa: F401
    accuracy,
    conductance,
    cost,
    fem,
    gap,
    hardness,
    metal,
    peers,
    theory,
    validity,
)
from epcontact.studies.frame import STUDIES, save_charts

__all__ = ["STUDIES", "save_charts"]
