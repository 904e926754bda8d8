"""Plastic flow as the memory of a capped contact: what a load leaves for the next one.

Where the pressure is at the hardness the surface has flowed.  The solver leaves the gap
g = u + z - h negative there.  The plastic displacement w, which is -g there and 0
elsewhere, is the depth by which the flow has lowered the surface.  On the surface h - w
that is left, the same pressures solve the *elastic* contact problem at the same load:
the gap g + w is nowhere negative, and it is zero wherever there is pressure.  So a
smaller load meets an elastic contact on h - w, the unloading branch; a larger load
meets the capped contact on h - w and adds to w.  The idea is that of Almqvist, Sahlin,
Larsson and Glavatskih, Tribology International 40 (2007) 574.

While the load grows, no pressure of a half-space falls.  So w only grows, and one solve
on the surface from which the loading began gives the same result as many solves on the
way.  The flow is taken over only where the load path turns down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.bem.problem import GridProblem, Options, PressureSolution
from epcontact.bem.solver import solve_problem
from epcontact.results import FloatArray

# At the peak load pressures may be off by this many times the error of one of them,
# because the errors of equal points add up.
_ERRORS_AT_PEAK = 10


@dataclass(frozen=True, eq=False)
class LoadedSurface:
    """A surface under one load of a path.

    Attributes:
        problem: the load on the heights that earlier flow has left.
        solution: the solution of this problem.
        flow_before: (nx, ny) plastic displacement before this load in m; None: there
            was none.
        flow_after: (nx, ny) plastic displacement after this load in m; None: nothing
            can flow.
    """

    problem: GridProblem
    solution: PressureSolution
    flow_before: FloatArray | None
    flow_after: FloatArray | None

    def gap(self) -> FloatArray:
        """Return the gap (nx, ny) in m to the surface that earlier flow has left."""
        return self.solution.gap(self.problem.heights)


def solve_load(
    problem: GridProblem,
    options: Options,
    start: FloatArray | None,
    flow: FloatArray | None,
    peak: float,
) -> LoadedSurface:
    """Solve one load of a path and find the plastic displacement after it.

    Args:
        problem: the load, which may be zero, on the heights that `flow` has left.
        options: how to solve.
        start: (nx, ny) pressure in Pa to start from; None: start on coarser grids.
        flow: (nx, ny) plastic displacement before this load in m; None: none.
        peak: load in Pa that has left this flow; below it nothing flows; 0: unknown.

    Raises:
        NotConverged: the tolerance was not met within the steps allowed.
    """
    load = problem.mean_pressure
    solution = solve_problem(problem, options, start) if load else _apart(problem)
    at_peak = math.isclose(load, peak, rel_tol=1e-12)
    if flow is not None and (at_peak or load > peak):
        if flow.any():
            error = _pressure_error(problem, solution, options.tolerance)
            _put_on_hardness(problem, solution, flow, error, peak)
        else:
            flow = None  # a plastic zone that no point shows flows on
    # At the peak the offset of a contact without elastic points is not the one of the
    # first time, so the flow of the first time is kept.
    flow_after = flow
    if math.isfinite(problem.hardness) and (flow is None or not at_peak):
        flow_after = plastic_displacement(problem, solution, flow)
    return LoadedSurface(problem, solution, flow, flow_after)


def _apart(problem: GridProblem) -> PressureSolution:
    """Return the solution at no load: no pressure, the flat on the highest point.

    problem: the grid and its heights; its mean pressure is not used.
    """
    p, u = np.zeros((2, *problem.symbol.shape))
    residuals = dict.fromkeys(("gap_elastic", "gap_sign", "bounds", "force"), 0.0)
    counts = dict.fromkeys(
        ("newton", "cg", "gradient", "fft_pairs", "equivalent_fft_pairs"), 0.0
    )
    return PressureSolution(p, u, float(problem.heights.max()), residuals, counts, ())


def plastic_displacement(
    problem: GridProblem, solution: PressureSolution, flow: FloatArray | None
) -> FloatArray:
    """Return the plastic displacement (nx, ny) in m after a load.

    It is the plastic displacement before the load, `flow` in m (None: there was none),
    plus -g where the pressure is at the hardness, with the gap g of the solution.

    problem: the load, on the heights that `flow` has left; solution: its solution.
    """
    w = solution.gap(problem.heights)
    w[solution.pressure < problem.hardness] = 0.0
    np.minimum(w, 0.0, out=w)
    np.abs(w, out=w)
    return w if flow is None else np.add(flow, w, out=w)


def _pressure_error(
    problem: GridProblem, solution: PressureSolution, tolerance: float
) -> float:
    """Return the error of a pressure in Pa: that of the gap times the stiffness.

    The error of the gap comes from the residuals of this solution and the tolerance of
    an earlier one, which left the flow.  The stiffness is that of the shortest wave.

    problem: of this solution; tolerance: of the residuals, dimensionless.
    """
    residual = max(solution.residuals.values()) + tolerance
    return residual * problem.gap_scale() / problem.symbol.shortest()


def _put_on_hardness(
    problem: GridProblem,
    solution: PressureSolution,
    flow: FloatArray,
    error: float,
    peak: float,
) -> None:
    """Set pressures that have returned to the hardness, within their error, to it.

    problem: the load on the surface that earlier flow has left; solution: its
    pressures are changed in place; flow: (nx, ny) plastic displacement before this load
    in m; error: of a pressure in Pa; peak: largest load before in Pa, 0 if unknown.

    When a load returns to the largest one before it, both the gap and the distance of
    the pressure from the hardness vanish where the surface has flowed: rounding would
    decide what is plastic.  At the peak load some times the error of a pressure (Pa) is
    allowed, for points whose errors are equal.  If the peak is unknown (0), the load
    counts as a return only if the mean pressure on the flowed points, whose error is
    far smaller, is at the hardness.  The pressures are changed in place.
    """
    pressure = solution.pressure
    hardness = problem.hardness
    flowed = flow > 0
    if not peak > 0 and hardness - pressure.mean(where=flowed) > error / 10:
        return
    allowed = error
    if math.isclose(problem.mean_pressure, peak, rel_tol=1e-12):
        allowed = _ERRORS_AT_PEAK * error
    back = flowed & (pressure >= hardness - allowed)
    excess = float(np.sum(hardness - pressure, where=back))
    pressure[back] = hardness
    # The other points give back what these have gained, far below their error.
    between = (pressure > 0) & (pressure < hardness)
    if between.any():
        pressure[between] *= max(0.0, 1 - excess / float(pressure[between].sum()))
