"""The cheapest model of a scene that meets a tolerance.

`plan` chooses the model by a few pilot solves, `planned_case` applies it to the case,
and `achieved_error` judges its answer by that to `finer_case`.  `auto_case` and
`load_auto` make a case as cheap as its gates allow.
"""

from epcontact.planning.map_errors import MapErrors, expected_map_errors
from epcontact.planning.plan import (
    Plan,
    achieved_error,
    auto_case,
    finer_case,
    load_auto,
    plan,
    planned_case,
)

__all__ = [
    "MapErrors",
    "Plan",
    "achieved_error",
    "auto_case",
    "expected_map_errors",
    "finer_case",
    "load_auto",
    "plan",
    "planned_case",
]
