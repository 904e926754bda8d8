"""Boundary elements on a periodic grid: rough contact with the pressure capped at the hardness.

`solve` answers a scene; `solve_pressure` is the same on plain arrays.
"""

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined

from epcontact.bem.driver import solve  # noqa: E402
from epcontact.bem.solver import Options, PressureSolution, solve_pressure  # noqa: E402

__all__ = ["Options", "PressureSolution", "solve", "solve_pressure"]
