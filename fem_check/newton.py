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

Signs: F presses down, the body feels -F; R = -(internal force) - (capped forces) is the residual
with the contact forces left in it, so R = F on the contact nodes of a solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import ELASTIC, PLASTIC
from fem_check import plasticity
from fem_check.contact import States, predicted_states, press
from fem_check.element import Elements, FloatArray
from fem_check.linear_solver import Factor, eliminate, substitute, top_descent
from fem_check.mesh import Block
from fem_check.plasticity import History, Law, Softening
from fem_check.vectors import add, dot, follow, norm


@dataclass(frozen=True)
class Problem:
    """What stays the same over a load path.

    bricks: of the true geometry; `flat` says that the factor's block has the same.
    heights: (nx, ny) of the top, in m.  cap: the largest nodal force, in N.
    """

    block: Block
    bricks: Elements
    factor: Factor
    law: Law
    heights: FloatArray
    cap: float = np.inf
    flat: bool = True

    @property
    def plastic(self) -> bool:
        """Whether the material can flow."""
        return bool(np.isfinite(self.law.yield_stress))


@dataclass(frozen=True)
class Control:
    """Prescribed: the total force `load` in N, or where it is None the `approach` in m.
    `scale` is the force that residuals are divided by; 0: the force reached."""

    load: float | None = None
    approach: float = 0.0
    scale: float = 0.0


@dataclass(frozen=True)
class State:
    """A state of the block: displacement (nz + 1, nx, ny, 3), approach, contact states and
    nodal forces (nx, ny)."""

    displacement: FloatArray
    approach: float
    states: States
    forces: FloatArray


@dataclass
class Counts:
    """Iterations of a load step and its relative residual after each Newton iteration."""

    newton: int = 0
    cg: int = 0
    sweeps: int = 0
    cuts: int = 0
    largest_cg: int = 0
    largest_newton: int = 0
    increments: int = 0
    history: list[float] = field(default_factory=list)


def internal_force(
    problem: Problem, u: FloatArray, history: History
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The internal force of the displacement `u`, same shape, and which elements flow."""
    out = np.empty_like(u)
    flat = out.reshape(-1, 3)
    if problem.plastic:
        yielded = plasticity.force(u.reshape(-1, 3), problem.bricks, problem.law, history, flat)
    else:
        plasticity.elastic_force(u.reshape(-1, 3), problem.bricks, problem.law, flat)
        yielded = np.zeros(problem.bricks.number, dtype=np.bool_)
    return out, yielded


def _release_base(problem: Problem, force: FloatArray) -> None:
    """Drops the base's reactions from a force, in place."""
    if problem.block.sliding:
        force[-1, ..., 2] = 0
    else:
        force[-1] = 0


def _residual(
    problem: Problem, R: FloatArray, states: States, control: Control
) -> tuple[FloatArray, float, FloatArray]:
    """(r, r_d, F): the residual without the contact forces, the missing load, and the forces."""
    contact = states == ELASTIC
    forces = np.where(contact, R[0, ..., 2], 0.0)
    r = R.copy()
    r[0, ..., 2][contact] = 0
    total = float(forces.sum())
    if np.isfinite(problem.cap):
        total += problem.cap * float((states == PLASTIC).sum())
    return r, 0.0 if control.load is None else control.load - total, forces


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
        _release_base(problem, out)
    if softening is not None and softening.which.size:
        plasticity.soften(
            v.reshape(-1, 3), problem.bricks, softening, 1 - blend, out.reshape(-1, 3)
        )
        _release_base(problem, out)
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
        r, r_d, _ = _residual(problem, linear.R, states, control)
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
    r, r_d, _ = _residual(problem, R, state.states, control)
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
        settled = bool(np.array_equal(new, linear.states))
        if not settled:
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


def residuals(
    problem: Problem, state: State, internal: FloatArray, control: Control
) -> dict[str, float]:
    """Dimensionless residuals of a state with its `internal` force.

    balance: norm of the unbalanced nodal forces over the total force; load: missing share of it;
    gap: largest gap on the elastic contact, penetration: deepest node elsewhere, both over the
    rms height; tension: largest pull of a contact node, over the total force.
    """
    R = _open_residual(problem, state.states, internal)
    capped = state.states == PLASTIC
    r, r_d, forces = _residual(problem, R, state.states, control)
    pressed = float(forces.sum()) + (problem.cap * int(capped.sum()) if capped.any() else 0.0)
    total = control.scale or pressed or 1.0
    rms = float(np.std(problem.heights)) or float(np.abs(state.approach)) or 1.0
    gap = -state.displacement[0, ..., 2] - problem.heights - state.approach
    contact = state.states == ELASTIC
    apart = ~contact & ~capped
    return {
        "balance": norm(r) / total,
        "load": abs(r_d) / total,
        "gap": float(np.abs(gap[contact]).max(initial=0.0)) / rms,
        "penetration": max(
            float((-gap[apart]).max(initial=0.0)), float(gap[capped].max(initial=0.0))
        )
        / rms,
        "tension": float((-forces[contact]).max(initial=0.0)) / total,
    }


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
        R = _open_residual(problem, state.states, internal)
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


def _open_residual(problem: Problem, states: States, internal: FloatArray) -> FloatArray:
    """R of the module's docstring."""
    R = -internal
    _release_base(problem, R)
    if np.isfinite(problem.cap):
        R[0, ..., 2] -= problem.cap * (states == PLASTIC)
    return R


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
