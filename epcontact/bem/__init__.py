"""Boundary elements on a periodic grid: rough contact with the pressure capped at the hardness.

`solve` solves a scene; `solve_pressure` does the same on plain arrays.  The modules, in the order
in which a scene passes through them:

    driver      scene -> problem (GridProblem, Options)  -> result
    solver      solves on coarse grids first (cascade); each grid is a level
    newton      the Newton method (with descent, bounds); baselines has classic methods
    inner/      the linear problem of a step: conjugate gradients, operators, preconditioner
    transforms  convolutions with the compliance (kernel), in blocks on threads (workers)
    areas/      contact areas in the continuum limit (the rim correction), pressure distributions
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined

from epcontact.bem.driver import solve  # noqa: E402
from epcontact.bem.problem import METHODS, GridProblem, Options, PressureSolution  # noqa: E402
from epcontact.bem.solver import solve_pressure  # noqa: E402

__all__ = ["METHODS", "GridProblem", "Options", "PressureSolution", "solve", "solve_pressure"]
