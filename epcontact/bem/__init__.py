"""Boundary elements on a periodic grid: rough contact with the pressure capped at the hardness.

`solve` answers a scene; `solve_pressure` is the same on plain arrays.  The way of a scene through
the package:

    driver      scene -> problem (GridProblem, Options)  -> result
    solver      coarse grids first (cascade), each one a level
    newton      the method: sets, steps (descent, bounds); baselines: classic methods instead
    inner/      the linear problem within a step: cg, its operators and preconditioner
    transforms  convolutions with the compliance (kernel), by blocks shared out by workers
    areas/      contact areas in the continuum limit (the rim correction), pressure distributions
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined

from epcontact.bem.driver import solve  # noqa: E402
from epcontact.bem.problem import METHODS, GridProblem, Options, PressureSolution  # noqa: E402
from epcontact.bem.solver import solve_pressure  # noqa: E402

__all__ = ["METHODS", "GridProblem", "Options", "PressureSolution", "solve", "solve_pressure"]
