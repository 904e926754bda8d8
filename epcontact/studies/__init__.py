"""Studies: charts of accuracy against cost, and of the theory against the numerical methods.

A study is a function with the decorator `study` of `frame`, in one of the modules below; the times
in a chart come from one run on one machine, so only their ratios are comparable.
"""

from epcontact.studies import (
    accuracy,
    areas,
    cost,
    fem,
    gap,
    hardness,
    left,
    peers,
    pressures,
    theory,
)
from epcontact.studies.frame import STUDIES, save_charts

__all__ = [
    "STUDIES",
    "accuracy",
    "areas",
    "cost",
    "fem",
    "gap",
    "hardness",
    "left",
    "peers",
    "pressures",
    "save_charts",
    "theory",
]
