"""One load step: a globalised Newton method whose linearised problem keeps the contact exact.

Each iteration freezes the material's consistent tangent and solves the contact problem of that
linear body: equality-constrained solves on a guessed contact set, which then changes until its
forces press and its gaps are open (a primal-dual active set).  The step to that solution is taken
whole unless the energy's slope along it shows that it overshoots.  Merging the two loops, or
starting cold with full steps, lets the contact set jump between a few nodes and all of them.

Far from the solution the tangent is blended with the elastic stiffness, by a tenth of the relative
residual: a fully plastic contact has next to no stiffness of its own to aim with.

The linear solves are conjugate gradients in the null space of the constraints, preconditioned by
the elastic flat block with the same constraints met exactly (a constraint preconditioner; Gould,
Hribar and Nocedal 2001).  On the flat block the elastic stiffness times a preconditioned residual
is that residual, so a product with the tangent touches the flowing elements only.

The signs are those of `problem`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import APART, ELASTIC, PLASTIC
from fem_check import plasticity
from fem_check.contact import States, predicted_states, press
from fem_check.element import FloatArray
from fem_check.linear_solver import eliminate, substitute, top_descent
from fem_check.plasticity import History, Softening
from fem_check.problem import (
    Control,
    Counts,
    Problem,
    State,
    internal_force,
    open_residual,
    release_base,
    residuals,
    split_residual,
)
from fem_check.vectors import add, dot, follow, norm

#: The contact set counts as settled when its changes, as a share of the contact, are below this
#: share of the reduction that the linear solve aims at: the next iteration moves more than that.
#: What a wrong node leaves shows in the residuals of tension and penetration.
UNSETTLED = 0.1


def _product(
    problem: Problem,
    softening: Softening | None,
    blend: float,
    v: FloatArray,
    elastic: FloatArray,
) -> FloatArray:
    """The blended tangent times `v`; `elastic` is the flat block's elastic product."""
    if problem.flat:
        out = elastic.copy()
    else:
        out = np.empty_like(v)
        plasticity.elastic_force(v.reshape(-1, 3), problem.bricks, problem.law, out.reshape(-1, 3))
        release_base(problem, out)
    if softening is not None and softening.which.size:
        plasticity.soften(
            v.reshape(-1, 3), problem.bricks, softening, 1 - blend, out.reshape(-1, 3)
        )
        release_base(problem, out)
    return out


def _elastic_solve(
    problem: Problem,
    r: FloatArray,
    states: States,
    wanted: FloatArray,
    load: float | None,
    tolerance: float,
    start: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, float]:
    """(z, forces, approach) with K_elastic z = r - forces, z descending by `wanted` + approach
    on the contact nodes."""
    spectrum = eliminate(problem.factor, r)
    descent = top_descent(problem.factor, spectrum)
    solved = press(
        problem.factor.surface,
        wanted - descent,
        states == ELASTIC,
        load,
        start=start,
        tolerance=tolerance,
    )
    z = substitute(problem.factor, spectrum, solved.forces)
    return z, solved.forces, solved.approach


@dataclass
class _Linear:
    """The linearised contact problem while it is solved."""

    step: FloatArray
    R: FloatArray
    approach: float
    states: States


def _solve_on_set(
    problem: Problem,
    state: State,
    linear: _Linear,
    tangent: Callable[[FloatArray, FloatArray], FloatArray],
    control: Control,
    goal: float,
    counts: Counts,
) -> None:
    """Solves the linear body on the present contact set to a residual of `goal`, in N."""
    u, states = state.displacement, linear.states
    capped = problem.cap * (states == PLASTIC) if np.isfinite(problem.cap) else None
    load = control.load
    if load is not None and capped is not None:
        load -= float(capped.sum())
    offset = 0.0 if load is not None else control.approach
    wanted = problem.heights + offset + u[0, ..., 2] + linear.step[0, ..., 2]
    contact = states == ELASTIC
    # All of the contact force is sought anew, so R goes in as it stands.
    z, forces, d = _elastic_solve(
        problem,
        linear.R,
        states,
        wanted,
        load,
        1e-11,
        np.where(contact, linear.R[0, ..., 2], 0.0),
    )
    linear.approach = d + offset
    linear.step += z
    elastic = linear.R.copy()
    elastic[0, ..., 2] -= forces
    linear.R -= tangent(z, elastic)
    counts.cg += 1
    spent = 1
    p = elastic_p = np.empty(0)
    rho_before = zeta_p = 0.0
    while spent < 400:
        r, r_d, _ = split_residual(problem, linear.R, states, control)
        if norm(r) + abs(r_d) <= goal:
            break
        zero = np.zeros_like(wanted)
        z, forces, zeta = _elastic_solve(
            problem, r, states, zero, None if load is None else r_d, 1e-6
        )
        r[0, ..., 2] -= forces
        rho = dot(r, z) + float((forces * z[0, ..., 2]).sum()) + r_d * zeta
        if spent == 1:
            p, elastic_p, zeta_p = z, r, zeta
        else:
            beta = rho / rho_before
            follow(p, beta, z)
            follow(elastic_p, beta, r)
            zeta_p = zeta + beta * zeta_p
        Kp = tangent(p, elastic_p)
        alpha = rho / dot(p, Kp)
        add(linear.step, alpha, p)
        linear.approach += alpha * zeta_p
        add(linear.R, -alpha, Kp)
        rho_before = rho
        counts.cg += 1
        spent += 1
    counts.largest_cg = max(counts.largest_cg, spent)


def solve_linear(
    problem: Problem,
    state: State,
    softening: Softening,
    right: FloatArray,
    control: Control,
    goal: float,
    counts: Counts,
) -> FloatArray:
    """The displacement under the forces `right` of the body frozen at `softening`, the contact
    nodes of `state` held where `control` wants them; to a residual of `goal`, in N."""
    linear = _Linear(np.zeros_like(right), right.copy(), state.approach, state.states)
    tangent = partial(_product, problem, softening, 0.0)
    _solve_on_set(problem, state, linear, tangent, control, goal, counts)
    return linear.step


def _linear_contact(
    problem: Problem,
    state: State,
    R: FloatArray,
    tangent: Callable[[FloatArray, FloatArray], FloatArray],
    control: Control,
    effort: tuple[float, int],
    counts: Counts,
) -> _Linear:
    """Solves the contact problem of the body with a frozen `tangent`, to `effort`: the
    reduction of the residual, and the most changes of the contact set."""
    forcing, sweeps = effort
    linear = _Linear(np.zeros_like(R), R.copy(), state.approach, state.states)
    stiffness = 1.0 / float(problem.factor.surface.min())
    r, r_d, _ = split_residual(problem, R, state.states, control)
    scale = max(norm(r) + abs(r_d), 1e-300)
    for sweep in range(sweeps):
        tight = sweep >= 8
        _solve_on_set(
            problem,
            state,
            linear,
            tangent,
            control,
            forcing * scale * (1 if tight else 5),
            counts,
        )
        counts.sweeps += 1
        new = _states_of(problem, state, linear, stiffness)
        changed = int((new != linear.states).sum())
        settled = changed <= UNSETTLED * forcing * int((new != APART).sum())
        if changed:
            _change_caps(problem, linear, new)
        linear.states = new
        if settled:
            break
    return linear


def _change_caps(problem: Problem, linear: _Linear, new: States) -> None:
    """Moves the capped forces in R to the new states."""
    if np.isfinite(problem.cap):
        before, after = linear.states == PLASTIC, new == PLASTIC
        linear.R[0, ..., 2] += problem.cap * (before.astype(float) - after.astype(float))


def _states_of(problem: Problem, state: State, linear: _Linear, stiffness: float) -> States:
    """The states that the linear solution asks for."""
    u, states = state.displacement, linear.states
    forces = np.where(states == ELASTIC, linear.R[0, ..., 2], 0.0)
    if np.isfinite(problem.cap):
        forces = np.where(states == PLASTIC, problem.cap, forces)
    gap = -(u[0, ..., 2] + linear.step[0, ..., 2]) - problem.heights - linear.approach
    gap[states == ELASTIC] = 0
    return predicted_states(forces, gap, problem.cap, stiffness)


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
        tangent = partial(
            _product, problem, softening, 0.1 * balance if options.regularise else 0.0
        )
        forcing = max(min(0.1, balance), 0.1 * options.tolerance / max(balance, 1e-300))
        R = open_residual(problem, state.states, internal)
        linear = _linear_contact(
            problem, state, R, tangent, control, (min(forcing, 0.5), options.sweeps), counts
        )
        counts.newton += 1
        held = control.load is not None or linear.approach == state.approach
        if options.line_search and problem.plastic and balance > 1e-4 and held:
            share = _share(problem, state, internal, linear, history, control, counts)
        else:
            share = 1.0
        state, internal, yielded = _taken(problem, state, linear, share, history)


def _share(
    problem: Problem,
    state: State,
    internal: FloatArray,
    linear: _Linear,
    history: History,
    control: Control,
    counts: Counts,
) -> float:
    """How much of the step to take: all, or up to where the energy stops falling along it."""
    lift = (control.load or 0.0) * (linear.approach - state.approach)
    before = dot(internal, linear.step) - lift
    if before >= 0:
        return 1.0
    low, slope_low, high, slope_high, share = 0.0, before, np.inf, 0.0, 1.0
    for _ in range(12):
        u = state.displacement + share * linear.step
        here = dot(internal_force(problem, u, history)[0], linear.step) - lift
        if here <= -0.3 * before and (share == 1.0 or here >= 0.8 * before):
            break
        counts.cuts += 1
        if here > 0:
            high, slope_high = share, here
        else:
            low, slope_low = share, here
        where = slope_low / (slope_low - slope_high)
        share = low + min(max(where, 0.1), 0.9) * (high - low)
    return share


def _taken(
    problem: Problem, state: State, linear: _Linear, share: float, history: History
) -> tuple[State, FloatArray, NDArray[np.bool_]]:
    """The state after a `share` of the step, its internal force, and which elements flow."""
    u = state.displacement + share * linear.step
    force, yielded = internal_force(problem, u, history)
    states = linear.states
    forces = np.where(states == ELASTIC, -force[0, ..., 2], 0.0)
    if np.isfinite(problem.cap):
        forces = np.where(states == PLASTIC, problem.cap, forces)
    approach = state.approach + share * (linear.approach - state.approach)
    return State(u, approach, states, forces), force, yielded
