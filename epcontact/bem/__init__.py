"""Boundary elements on a periodic grid: rough contact with the pressure capped.

`solve` solves a scene; `solve_pressure` does the same on plain arrays.  The modules, in
the order in which a scene passes through them:

    driver      scene -> problem (GridProblem, Options) -> result
    flow        plastic flow, with which a load meets the next one of its path
    solver      solves on coarse grids first; each grid is a level
    newton      the Newton method, with bounds
    inner/      the linear problem of a step: operators, preconditioner
    transforms  convolutions with the compliance (kernel), on threads (workers)
    areas/      contact areas in the continuum limit, pressure distributions
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from epcontact.bem.driver import solve
    from epcontact.bem.problem import GridProblem, Options, PressureSolution
    from epcontact.bem.solver import solve_pressure

__all__ = [
    "GridProblem",
    "Options",
    "PressureSolution",
    "solve",
    "solve_pressure",
]


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, so that the package loads no compiler."""
    if name not in __all__:
        raise AttributeError(f"module 'epcontact.bem' has no attribute {name!r}")
    homes = {"solve": "driver", "solve_pressure": "solver"}
    module = importlib.import_module(f"epcontact.bem.{homes.get(name, 'problem')}")
    return getattr(module, name)
