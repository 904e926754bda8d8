"""One load step: a globalised Newton method whose linearised problem keeps the contact exact.

Each iteration freezes the material's consistent tangent and solves the contact problem of that
linear body (`linearised`).  The step to that solution is taken whole unless the energy's slope
along it shows that it overshoots.  Merging the two loops, or starting cold with full steps, lets
the contact set jump between a few nodes and all of them.

Far from the solution the tangent is blended with the elastic stiffness, by a tenth of the relative
residual: a fully plastic contact has next to no stiffness of its own to aim with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import ELASTIC, PLASTIC, FloatArray
from fem_check import plasticity
from fem_check.linearised import Linear, Tangent, linear_contact
from fem_check.plasticity import History
from fem_check.problem import (
    Control,
    Counts,
    Problem,
    State,
    internal_force,
    open_residual,
    residuals,
)
from fem_check.vectors import dot


@dataclass(frozen=True)
class Options:
    """How a step is solved.  The last three are what the method needs to be robust; switching
    them off shows why.

    line_search: shorten steps that overshoot.  regularise: blend the tangent with the elastic
    stiffness far from the solution.  sweeps: changes of the contact set within one iteration.
    """

    tolerance: float = 1e-8
    max_newton: int = 30
    line_search: bool = True
    regularise: bool = True
    sweeps: int = 12


def solve_step(
    problem: Problem,
    state: State,
    history: History,
    control: Control,
    options: Options | None = None,
) -> tuple[State, Counts, dict[str, float]]:
    """The converged state at `control`, starting from `state`; `history` is read only.

    Raises NotConverged with the residuals of every iteration.
    """
    options = options or Options()
    counts = Counts(increments=1)
    internal, yielded = internal_force(problem, state.displacement, history)
    while True:
        found = residuals(problem, state, internal, control)
        worst = max(found.values())
        counts.history.append(worst)
        if worst <= options.tolerance and counts.newton > 0:
            return state, counts, found
        if counts.newton >= options.max_newton or not np.isfinite(worst):
            raise NotConverged(
                f"the load step did not converge in {counts.newton} Newton iterations: relative "
                f"residual {worst:.2e} instead of {options.tolerance:.0e}",
                residuals=found,
                history=counts.history,
            )
        balance = min(1.0, found["balance"] + found["load"])
        softening = None
        if problem.plastic:
            softening = plasticity.linearise(
                state.displacement.reshape(-1, 3), problem.bricks, problem.law, history, yielded
            )
        tangent = Tangent(problem, softening, 0.1 * balance if options.regularise else 0.0)
        forcing = max(min(0.1, balance), 0.1 * options.tolerance / max(balance, 1e-300))
        R = open_residual(problem, state.states, internal)
        effort = (min(forcing, 0.5), options.sweeps)
        linear = linear_contact(state, R, tangent, control, effort, counts)
        counts.newton += 1
        held = control.load is not None or linear.approach == state.approach
        if options.line_search and problem.plastic and balance > 1e-4 and held:
            share = _searched(problem, state, internal, linear, history, control, counts)
        else:
            share = _share_of(problem, state, linear, 1.0, history)
        state, internal, yielded = _taken(problem, state, linear, share), share.force, share.yielded


@dataclass(frozen=True)
class _Share:
    """A share of the step, with the displacement, the internal force and the flow at its end."""

    share: float
    displacement: FloatArray
    force: FloatArray
    yielded: NDArray[np.bool_]


def _share_of(
    problem: Problem, state: State, linear: Linear, share: float, history: History
) -> _Share:
    u = state.displacement + share * linear.step
    return _Share(share, u, *internal_force(problem, u, history))


def _searched(
    problem: Problem,
    state: State,
    internal: FloatArray,
    linear: Linear,
    history: History,
    control: Control,
    counts: Counts,
) -> _Share:
    """As much of the step as is good: all, or up to where the energy stops falling along it."""
    lift = (control.load or 0.0) * (linear.approach - state.approach)
    before = dot(internal, linear.step) - lift
    here = _share_of(problem, state, linear, 1.0, history)
    if before >= 0:
        return here
    low, slope_low, high, slope_high = 0.0, before, np.inf, 0.0
    for _ in range(12):
        slope = dot(here.force, linear.step) - lift
        if slope <= -0.3 * before and (here.share == 1.0 or slope >= 0.8 * before):
            break
        counts.cuts += 1
        if slope > 0:
            high, slope_high = here.share, slope
        else:
            low, slope_low = here.share, slope
        where = slope_low / (slope_low - slope_high)
        share = low + min(max(where, 0.1), 0.9) * (high - low)
        here = _share_of(problem, state, linear, share, history)
    return here


def _taken(problem: Problem, state: State, linear: Linear, share: _Share) -> State:
    """The state after a share of the step."""
    states = linear.states
    forces = np.where(states == ELASTIC, -share.force[0, ..., 2], 0.0)
    if np.isfinite(problem.cap):
        forces = np.where(states == PLASTIC, problem.cap, forces)
    approach = state.approach + share.share * (linear.approach - state.approach)
    return State(share.displacement, approach, states, forces)
