"""Quantities: every value of a result that a gate can read.

A function is in the registry `QUANTITIES` once its module is imported.
"""

import importlib

from epcontact.harness.quantities import (  # noqa: F401
    filled,
    identities,
    measurements,
)

#: Modules of rooms above the harness that register quantities.  They are named and not
#: imported by a statement, because imports lead down.
_ABOVE = (
    "epcontact.crosscheck.model_difference",
    "epcontact.crosscheck.second_solves",
)

for _module in _ABOVE:
    importlib.import_module(_module)
