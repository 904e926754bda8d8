"""Studies: charts of accuracy against cost, and of the theory against the numerical methods.

A study is a function with the decorator `study` of `frame`, in one of the modules below; the times
in a chart come from one run on one machine, so only their ratios are comparable.
"""

import epcontact.studies.areas
import epcontact.studies.cost
import epcontact.studies.fem
import epcontact.studies.gap
import epcontact.studies.hardness
import epcontact.studies.peers
import epcontact.studies.theory  # noqa: F401 - each registers its studies
from epcontact.studies.frame import STUDIES, save_charts

__all__ = ["STUDIES", "save_charts"]
