"""Boundary elements on a periodic grid: rough contact with the pressure capped at the hardness.

`solve` answers a scene; `solve_pressure` is the same on plain arrays.
"""

from epcontact.bem.driver import solve
from epcontact.bem.solver import Options, PressureSolution, solve_pressure

__all__ = ["Options", "PressureSolution", "solve", "solve_pressure"]
