"""Plastic flow as the memory of a capped contact: what a load leaves behind for the
next one.

Where the pressure is at the hardness the surface has flowed, and the gap g = u + z - h,
which the solver leaves negative there, says how far: the plastic displacement w = -g
there, and 0 elsewhere, is what the flow has lowered the surface by.  On the surface h -
w that is left, the same pressures solve the *elastic* contact problem at the same load:
the gap g + w is nowhere negative, and is zero wherever there is pressure.  So a smaller
load meets an elastic contact on h - w, the unloading branch; a larger one meets the
capped contact on h - w and adds to w.  The idea is that of Almqvist, Sahlin, Larsson
and Glavatskih, Tribology International 40 (2007) 574.

While the load grows, no pressure of a half-space falls, hence w only grows, and one
solve on the surface from which the loading began gives the same answer as many on the
way.  So the flow needs to be taken over only where the path turns down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.bem.problem import GridProblem, Options, PressureSolution
from epcontact.bem.solver import solve_problem
from epcontact.results import FloatArray


@dataclass(frozen=True, eq=False)
class LoadedSurface:
    """A surface under one load of a path."""

    problem: GridProblem  # the load on the heights that earlier flow has left
    solution: PressureSolution
    before: (
        FloatArray | None
    )  # (nx, ny) w of that earlier flow in m; None: there was none
    after: FloatArray | None  # (nx, ny) w after this load in m; None: nothing can flow

    def gap(self) -> FloatArray:
        """(nx, ny) the gap in m to the surface that earlier flow has left."""
        return self.solution.gap(self.problem.heights)


def loaded(
    problem: GridProblem,
    options: Options,
    start: FloatArray | None,
    before: FloatArray | None,
    peak: float,
) -> LoadedSurface:
    """Solve one load of a path, which may be zero, and find the plastic displacement
    after it. Below `peak`, the load in Pa that has left the one before, nothing flows;
    0: it is not known.
    """
    solution = (
        solve_problem(problem, options, start)
        if problem.mean_pressure
        else _apart(problem)
    )
    again = math.isclose(problem.mean_pressure, peak, rel_tol=1e-12)
    if before is not None and (again or problem.mean_pressure > peak):
        if before.any():
            _put_on_hardness(
                problem, solution, before, options.tolerance, again, peak > 0
            )
        else:
            before = None  # a zone that no point shows flows on
    # At the peak the offset of a contact without elastic points is not that of the
    # first time.
    more = math.isfinite(problem.hardness) and (before is None or not again)
    after = flowed(problem, solution, before) if more else before
    return LoadedSurface(problem, solution, before, after)


def _apart(problem: GridProblem) -> PressureSolution:
    """The answer at no load: no pressure, and the flat on the highest point."""
    p, u = np.zeros((2, *problem.symbol.shape))
    residuals = dict.fromkeys(("gap_elastic", "gap_sign", "bounds", "force"), 0.0)
    counts = dict.fromkeys(
        ("newton", "cg", "gradient", "fft_pairs", "equivalent_fft_pairs"), 0.0
    )
    return PressureSolution(p, u, float(problem.heights.max()), residuals, counts, ())


def flowed(
    problem: GridProblem, solution: PressureSolution, before: FloatArray | None
) -> FloatArray:
    """The plastic displacement in m after a load: that `before`, and -g at the
    hardness.
    """
    w = solution.gap(problem.heights)
    w[solution.pressure < problem.hardness] = 0.0
    np.abs(np.minimum(w, 0.0, out=w), out=w)
    return w if before is None else np.add(before, w, out=w)


def _put_on_hardness(
    problem: GridProblem,
    solution: PressureSolution,
    before: FloatArray,
    tolerance: float,
    again: bool,
    known: bool,
) -> None:
    """Put pressures on the hardness, in place, that have come back to it within their
    error.

    When a load returns to the largest one before it, both the gap and the distance of
    the pressure from the hardness vanish where the surface has flowed: rounding would
    decide what is plastic. The error of a pressure is that of the gap, of this solve
    and of the one that left the surface, divided by the compliance of the shortest
    wave.  Where it is the peak `again`, some times that is allowed, for points that err
    alike; where the peak is not `known`, a load must show the far smaller error of the
    mean.
    """
    pressure, hardness, old = solution.pressure, problem.hardness, before > 0
    residual = max(solution.residuals.values()) + tolerance
    error = residual * problem.gap_scale() / problem.symbol.shortest()
    if not known and hardness - pressure.mean(where=old) > error / 10:
        return
    back = old & (pressure >= hardness - (10 * error if again else error))
    excess = float(np.sum(hardness - pressure, where=back))
    pressure[back] = hardness
    # The other points give back what these have gained, far below their error.
    between = (pressure > 0) & (pressure < hardness)
    if between.any():
        pressure[between] *= max(0.0, 1 - excess / float(pressure[between].sum()))
