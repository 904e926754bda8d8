"""One load increment: a globalised Newton method that keeps the contact exact.

Each iteration freezes the material's consistent tangent and solves the contact problem
of that linear body (`linearised`).  The full step to that solution is taken unless the
energy's slope along it shows that it overshoots.  If the two loops were merged, with
full steps and the pure tangent, the contact set of a cold start would jump between a
few nodes and all nodes.

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
MAX_ITERATIONS = 30
#: Times that a Newton step is shortened at most.
MAX_CUTS = 12
#: An iteration stagnates if these last residuals are all above this fraction of the
#: smallest residual before them.
STAGNATION = (4, 0.9)


@dataclass(frozen=True)
class SolvedIncrement:
    """A converged increment.

    Attributes:
        state: the converged state.
        flowing: (m,) True for the elements that flow.
        counts: numbers of iterations.
        residuals: of the state, by the names of `Problem.residuals`.
        history: largest residual at the begin and after each Newton iteration.
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
    patient: bool = True,
) -> SolvedIncrement:
    """Solve for the state that an increment's control prescribes, by Newton's method.

    Args:
        problem: the finite-element problem.
        state: first guess.
        history: plastic strains of the elements before the increment.
        control: prescribed load or approach.
        tolerance: on the largest residual, dimensionless.
        patient: whether the iteration goes on if the residual stagnates, as it does
            where the body has no equilibrium, and sometimes where it has one.

    Returns:
        The converged state, the elements that flow, the residuals and the iterations.
        The plastic strains are not yet added to the history.

    Raises:
        NotConverged: after `MAX_ITERATIONS` (30), at a residual that is not finite, or
            at one that stagnates without `patient`; the error holds the residuals of
            all iterations.
    """
    counts = Counts(increments=1)
    largest_residuals = []
    internal, flowing = problem.internal_force(state.displacement, history)
    while True:
        R = problem.reaction(state.states, internal)
        residuals = problem.residuals(state, R, control)
        largest = max(residuals.values())
        largest_residuals.append(largest)
        if largest <= tolerance and counts.newton > 0:
            counts = replace(counts, most_newton=counts.newton)
            return SolvedIncrement(
                state, flowing, counts, residuals, tuple(largest_residuals)
            )
        given_up = counts.newton >= MAX_ITERATIONS or not np.isfinite(largest)
        if given_up or (not patient and _stagnates(largest_residuals)):
            raise NotConverged(
                f"the load step did not converge in {counts.newton} Newton iterations: "
                f"relative residual {largest:.2e} instead of {tolerance:.0e}",
                residuals=residuals,
                history=largest_residuals,
            )
        balance = min(1.0, residuals["balance"] + residuals["load"])
        goal = 0.1 * tolerance / max(balance, 1e-300)
        forcing = min(0.5, max(min(0.1, balance), goal))
        tangent = _tangent(problem, state, history, flowing, 0.1 * balance)
        linear, linear_counts = linear_contact(state, R, tangent, control, forcing)
        # While a prescribed approach still moves, the work of the flat is not known.
        knows_work = control.load is not None or linear.approach == state.approach
        shorten = problem.plastic and balance > 1e-4 and knows_work
        trial, cuts = _step(problem, state, internal, linear, history, control, shorten)
        counts += linear_counts + Counts(newton=1, line_searches=cuts)
        state = State(
            trial.displacement,
            state.approach + trial.fraction * (linear.approach - state.approach),
            linear.states,
            problem.contact_forces(linear.states, -trial.force[0, ..., 2]),
        )
        internal = trial.force
        flowing = trial.flowing
        # Their fields would stay in memory during the next linear solve.
        del R, tangent, linear, trial


def _stagnates(residuals: list[float]) -> bool:
    """Return True if the last residuals of an iteration are no smaller than before.

    `residuals` are the largest ones, dimensionless, one for each iteration so far; see
    `STAGNATION`.
    """
    count, fraction = STAGNATION
    if len(residuals) <= count:
        return False
    return min(residuals[-count:]) > fraction * min(residuals[:-count])


def _tangent(
    problem: Problem,
    state: State,
    history: History,
    flowing: NDArray[np.bool_],
    blend: float,
) -> Tangent:
    """Return the consistent tangent at a state, blended with the elastic stiffness.

    Args:
        problem: the finite-element problem.
        state: with the displacements at which the tangent is computed.
        history: plastic strains of the elements before the increment.
        flowing: (m,) True for the elements that flow at the state.
        blend: fraction of the plastic correction that is left out, from 0 to 1.
    """
    if not problem.plastic:
        return Tangent(problem, None, blend)
    u = problem.physical_displacement(state.displacement).reshape(-1, 3)
    correction = plasticity.tangent_correction(
        u, problem.bricks, problem.law, history, flowing, problem.workers
    )
    return Tangent(problem, correction, blend)


class _Trial(NamedTuple):
    """The body after a fraction of the Newton step.

    Attributes:
        fraction: of the full step; 1 is the full step.
        displacement: (levels, nx, ny, 3) unknown displacements, in m.
        force: (levels, nx, ny, 3) internal force, in N.
        flowing: (m,) True for the elements that flow.
    """

    fraction: float
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
    shorten: bool,
) -> tuple[_Trial, int]:
    """Take the full Newton step, or a shorter one if the energy rises along it.

    Args:
        problem: the finite-element problem.
        state: at the begin of the step.
        internal: (levels, nx, ny, 3) internal force of this state, in N.
        linear: solution of the linearised contact problem, with the full step.
        history: plastic strains of the elements before the increment.
        control: whose prescribed load does work on the approach.
        shorten: whether the step may be shortened, to a point where the slope of the
            energy along the step is nearly zero.

    Returns:
        The body at the end of the step, and how often the step was shortened, at most
        `MAX_CUTS` (12) times.
    """

    def trial_at(fraction: float) -> _Trial:
        """Return the body after a fraction of the Newton step, from 0 to 1 or more."""
        u = state.displacement + fraction * linear.step
        return _Trial(fraction, u, *problem.internal_force(u, history))

    trial = trial_at(1.0)
    load = control.load or 0.0
    work = load * (linear.approach - state.approach)
    initial_slope = dot(internal, linear.step) - work
    if not shorten or initial_slope >= 0:
        return trial, 0
    low = 0.0
    low_slope = initial_slope
    high = np.inf
    high_slope = 0.0
    for cuts in range(MAX_CUTS):
        slope = dot(trial.force, linear.step) - work
        rises_little = slope <= -0.3 * initial_slope
        if rises_little and (trial.fraction == 1.0 or slope >= 0.8 * initial_slope):
            return trial, cuts
        if slope > 0:
            high = trial.fraction
            high_slope = slope
        else:
            low = trial.fraction
            low_slope = slope
        secant = low_slope / (low_slope - high_slope)
        trial = trial_at(low + min(max(secant, 0.1), 0.9) * (high - low))
    return trial, MAX_CUTS
