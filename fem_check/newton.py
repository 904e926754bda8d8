"""One load increment: a globalised Newton method whose linearised problem keeps the contact exact.

Each iteration freezes the material's consistent tangent and solves the contact problem of that
linear body (`linearised`).  The step to that solution is taken whole unless the energy's slope
along it shows that it overshoots.  With the two loops merged into one, or with full steps from a
cold start, the contact set jumped between a few nodes and all of them (tests/test_fem_solve.py).

Far from the solution the tangent is blended with the elastic stiffness, by a tenth of the relative
residual, because a fully plastic contact has almost no stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import ELASTIC, PLASTIC, FloatArray
from fem_check import plasticity
from fem_check.linearised import LinearSolution, Tangent, linear_contact
from fem_check.plasticity import History
from fem_check.problem import (
    Control,
    Counts,
    Problem,
    State,
    internal_force,
    reaction,
    residuals,
)
from fem_check.workers import dot


@dataclass(frozen=True)
class NewtonOptions:
    """Options of an increment; tests/test_fem_solve.py shows that the last three are needed.

    line_search: shorten steps that overshoot.  regularise: blend the tangent with the elastic
    stiffness far from the solution.  sweeps: changes of the contact set within one iteration.
    """

    tolerance: float = 1e-8
    max_newton: int = 30
    line_search: bool = True
    regularise: bool = True
    sweeps: int = 12


@dataclass(frozen=True)
class SolvedIncrement:
    """The converged state, and (m,) which elements flow there.

    `history` holds the largest residual after each Newton iteration.
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
    options: NewtonOptions | None = None,
) -> SolvedIncrement:
    """Solve for the state at `control`, starting from `state`.

    Raises NotConverged with the residuals of every iteration.
    """
    options = options or NewtonOptions()
    counts, worst = Counts(increments=1), []
    internal, flowing = internal_force(problem, state.displacement, history)
    while True:
        R = reaction(problem, state.states, internal)
        residual = residuals(problem, state, R, control)
        worst.append(max(residual.values()))
        if worst[-1] <= options.tolerance and counts.newton > 0:
            counts = replace(counts, most_newton=counts.newton)
            return SolvedIncrement(state, flowing, counts, residual, tuple(worst))
        if counts.newton >= options.max_newton or not np.isfinite(worst[-1]):
            raise NotConverged(
                f"the load step did not converge in {counts.newton} Newton iterations: relative "
                f"residual {worst[-1]:.2e} instead of {options.tolerance:.0e}",
                residuals=residual,
                history=worst,
            )
        balance = min(1.0, residual["balance"] + residual["load"])
        linear, spent = linear_contact(
            state,
            R,
            _tangent(
                problem, state, history, flowing, 0.1 * balance if options.regularise else 0.0
            ),
            control,
            forcing=min(
                0.5, max(min(0.1, balance), 0.1 * options.tolerance / max(balance, 1e-300))
            ),
            sweeps=options.sweeps,
        )
        held = control.load is not None or linear.approach == state.approach
        trial = _trial(problem, state, linear, 1.0, history)
        if options.line_search and problem.plastic and balance > 1e-4 and held:
            trial, tried = _line_search(problem, state, internal, linear, history, control, trial)
            spent += Counts(line_searches=tried)
        counts += spent + Counts(newton=1)
        state, internal, flowing = (
            _state_after(problem, state, linear, trial),
            trial.force,
            trial.flowing,
        )
        del R, linear, trial  # fields, which would stay in memory during the next linear solve


def _tangent(
    problem: Problem, state: State, history: History, flowing: NDArray[np.bool_], blend: float
) -> Tangent:
    if not problem.plastic:
        return Tangent(problem, None, blend)
    u = state.displacement.reshape(-1, 3)
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


def _trial(
    problem: Problem, state: State, linear: LinearSolution, share: float, history: History
) -> _Trial:
    u = state.displacement + share * linear.step
    return _Trial(share, u, *internal_force(problem, u, history))


def _line_search(
    problem: Problem,
    state: State,
    internal: FloatArray,
    linear: LinearSolution,
    history: History,
    control: Control,
    whole: _Trial,
) -> tuple[_Trial, int]:
    """The whole step, or its part up to where the energy stops falling; also the number of cuts."""
    work = (control.load or 0.0) * (linear.approach - state.approach)
    before = dot(internal, linear.step) - work
    trial, cuts = whole, 0
    if before >= 0:
        return trial, cuts
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
        share = low + min(max(secant, 0.1), 0.9) * (high - low)
        trial = _trial(problem, state, linear, share, history)
    return trial, cuts + 1


def _state_after(problem: Problem, state: State, linear: LinearSolution, trial: _Trial) -> State:
    forces = np.where(linear.states == ELASTIC, -trial.force[0, ..., 2], 0.0)
    if problem.capped:
        forces = np.where(linear.states == PLASTIC, problem.cap, forces)
    approach = state.approach + trial.share * (linear.approach - state.approach)
    return State(trial.displacement, approach, linear.states, forces)
