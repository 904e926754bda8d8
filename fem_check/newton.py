"""One load increment: a globalised Newton method whose linearised problem keeps the
contact exact.

Each iteration freezes the material's consistent tangent and solves the contact problem
of that linear body (`linearised`).  The step to that solution is taken whole unless the
energy's slope along it shows that it overshoots.  With the two loops merged into one,
full steps and the pure tangent, a cold start lets the contact set jump between a few
nodes and all of them.

Far from the solution the tangent is blended with the elastic stiffness, by a tenth of
the relative residual, because a fully plastic contact has almost no stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import FloatArray
from fem_check import plasticity
from fem_check.linearised import LinearSolution, Tangent, linear_contact
from fem_check.plasticity import History
from fem_check.problem import Control, Counts, Problem, State
from fem_check.workers import dot

#: Newton iterations after which an increment is given up.
MOST_NEWTON = 30


@dataclass(frozen=True)
class SolvedIncrement:
    """The converged state, which elements (m,) flow, and each iteration's largest
    residual.
    """

    state: State
    flowing: NDArray[np.bool_]
    counts: Counts
    residuals: dict[str, float]
    history: tuple[float, ...]


def solve_increment(
    problem: Problem,
    state: State,
    history: History,
    control: Control,
    tolerance: float = 1e-8,
) -> SolvedIncrement:
    """The state at `control`, from `state` on.  Raises NotConverged with every
    residual.
    """
    counts, worst = Counts(increments=1), []
    internal, flowing = problem.internal_force(state.displacement, history)
    while True:
        R = problem.reaction(state.states, internal)
        residual = problem.residuals(state, R, control)
        worst.append(max(residual.values()))
        if worst[-1] <= tolerance and counts.newton > 0:
            counts = replace(counts, most_newton=counts.newton)
            return SolvedIncrement(state, flowing, counts, residual, tuple(worst))
        if counts.newton >= MOST_NEWTON or not np.isfinite(worst[-1]):
            raise NotConverged(
                f"the load step did not converge in {counts.newton} Newton iterations: relative "
                f"residual {worst[-1]:.2e} instead of {tolerance:.0e}",
                residuals=residual,
                history=worst,
            )
        balance = min(1.0, residual["balance"] + residual["load"])
        forcing = min(
            0.5, max(min(0.1, balance), 0.1 * tolerance / max(balance, 1e-300))
        )
        tangent = _tangent(problem, state, history, flowing, 0.1 * balance)
        linear, spent = linear_contact(state, R, tangent, control, forcing)
        held = control.load is not None or linear.approach == state.approach
        shortened = problem.plastic and balance > 1e-4 and held
        trial, cuts = _step(
            problem, state, internal, linear, history, control, shortened
        )
        counts += spent + Counts(newton=1, line_searches=cuts)
        forces = problem.contact_forces(linear.states, -trial.force[0, ..., 2])
        approach = state.approach + trial.share * (linear.approach - state.approach)
        state = State(trial.displacement, approach, linear.states, forces)
        internal, flowing = trial.force, trial.flowing
        del (
            R,
            tangent,
            linear,
            trial,
        )  # fields, which would stay in memory in the next linear solve


def _tangent(
    problem: Problem,
    state: State,
    history: History,
    flowing: NDArray[np.bool_],
    blend: float,
) -> Tangent:
    if not problem.plastic:
        return Tangent(problem, None, blend)
    u = problem.turned(state.displacement).reshape(-1, 3)
    correction = plasticity.tangent_correction(
        u, problem.bricks, problem.law, history, flowing, problem.workers
    )
    return Tangent(problem, correction, blend)


class _Trial(NamedTuple):
    """The displacement, internal force and flow after a `share` of the Newton step."""

    share: float
    displacement: FloatArray
    force: FloatArray
    flowing: NDArray[np.bool_]


def _step(
    problem: Problem,
    state: State,
    internal: FloatArray,
    linear: LinearSolution,
    history: History,
    control: Control,
    shortened: bool,
) -> tuple[_Trial, int]:
    """The whole step or, if `shortened`, its part until the energy rises; and how often
    cut.
    """

    def after(share: float) -> _Trial:
        u = state.displacement + share * linear.step
        return _Trial(share, u, *problem.internal_force(u, history))

    trial, work = after(1.0), (control.load or 0.0) * (linear.approach - state.approach)
    before = dot(internal, linear.step) - work
    if not shortened or before >= 0:
        return trial, 0
    low, slope_low, high, slope_high = 0.0, before, np.inf, 0.0
    for cuts in range(12):
        slope = dot(trial.force, linear.step) - work
        if slope <= -0.3 * before and (trial.share == 1.0 or slope >= 0.8 * before):
            return trial, cuts
        if slope > 0:
            high, slope_high = trial.share, slope
        else:
            low, slope_low = trial.share, slope
        secant = slope_low / (slope_low - slope_high)
        trial = after(low + min(max(secant, 0.1), 0.9) * (high - low))
    return trial, 12
