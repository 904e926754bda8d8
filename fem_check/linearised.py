"""The contact problem of a body with a frozen material tangent.

A primal-dual active set method solves the equalities on a guessed contact set, which it
then changes until forces press and gaps are open.  The solves are conjugate gradients
in the null space of the constraints.  Their preconditioner is the elastic flat block
with the same constraints met exactly (a constraint preconditioner; Gould, Hribar and
Nocedal 2001), between two sweeps over the flowing nodes (`smoother`).

On the flat block the elastic stiffness times a preconditioned residual is that
residual, so a product with the tangent touches the flowing elements only.  After an
elastic solve all residuals lie on the levels of nodes that flow: the solves work on
these alone, and the step is continued to the base once.  The signs are those of
`problem`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from epcontact.results import APART, ELASTIC, FloatArray
from fem_check import plasticity
from fem_check.contact import States, predicted_states, solve_contact_forces
from fem_check.linear_solver import eliminate, extend_to_base, substitute, top_descent
from fem_check.plasticity import TangentCorrection
from fem_check.problem import (
    Control,
    Counts,
    Problem,
    State,
    unbalanced,
    unbalanced_norm,
)
from fem_check.smoother import FlowRows, Smoother, assemble
from fem_check.workers import axpy, dot, norm, xpay

#: The contact set is accepted when the share of its nodes that still change is below
#: this factor times `forcing`: the next Newton iteration moves more nodes.  A node in
#: the wrong set shows in the residuals of tension and penetration, so this affects the
#: work and not the answer.
UNSETTLED = 0.1
#: Levels whose residual is below this share of what the linear solve aims at are left
#: out of it.
NEGLIGIBLE = 0.01
#: A solve that reduces the residual by less takes too few iterations for a smoother to
#: pay.
WORTH_SMOOTHING = 0.1


@dataclass(frozen=True)
class Tangent:
    """The frozen body: the elastic stiffness plus (1 - blend) times the plastic
    `correction`.
    """

    problem: Problem
    correction: TangentCorrection | None
    blend: float = 0.0

    @cached_property
    def levels(self) -> int:
        """Number of levels of nodes, from the top, with a residual after an elastic
        solve.
        """
        every = len(self.problem.block.layers) + 1
        if not self.problem.flat:
            return every
        if self.correction is None:
            return 1
        deepest = int(self.correction.which.max(initial=0)) // self.problem.heights.size
        return min(deepest + 3, every)  # of the flowing elements and their neighbours

    def levels_with(self, R: FloatArray, norm_below: float) -> int:
        """Number of levels outside of which nothing flows and R has at most this
        norm.
        """
        below, level = 0.0, len(R)
        while level > self.levels and below <= norm_below:
            level -= 1
            below = math.hypot(below, norm(R[level], self.problem.workers))
        return level if below <= norm_below else level + 1

    @property
    def smoothed(self) -> bool:
        """True if some element flows, and its rows can be assembled."""
        flows = self.correction is not None and self.correction.which.size > 0
        return flows and self.problem.flat

    @cached_property
    def rows(self) -> FlowRows:
        """The matrix rows of the flowing nodes."""
        assert self.correction is not None
        return assemble(self.problem, self.correction, 1 - self.blend)

    def excess(self, v: FloatArray, elastic: FloatArray) -> FloatArray:
        """The stiffness times `v`, less `elastic`, the flat block's elastic product."""
        problem, out = self.problem, np.zeros_like(v)
        if self.correction is not None and self.correction.which.size:
            plasticity.add_correction(
                problem.turned(v).reshape(-1, 3),
                problem.bricks,
                self.correction,
                1 - self.blend,
                out.reshape(-1, 3),
                problem.workers,
            )
            problem.turned_back(out)
        if not problem.flat:
            out += problem.internal_force(v, None)[0] - elastic
        return problem.without_base(out)


@dataclass
class LinearSolution:
    """The step and the reaction that it leaves, both on the levels with residuals, and
    the rest.
    """

    step: FloatArray
    reaction: FloatArray
    approach: float
    states: States


def linear_contact(
    state: State,
    R: FloatArray,
    tangent: Tangent,
    control: Control,
    forcing: float,
    sweeps: int = 12,
) -> tuple[LinearSolution, Counts]:
    """Solve the contact of the tangent frozen at `state`, whose reaction is R; also
    counts.  The solves reduce the residual by `forcing`; the contact set changes at
    most `sweeps` times.
    """
    problem = tangent.problem
    missing = problem.missing_load(R, state.states, control)
    balance = unbalanced_norm(R, state.states, problem.workers)
    scale = max(balance + abs(missing), 1e-300)
    R = R[: tangent.levels_with(R, NEGLIGIBLE * forcing * scale)].copy()
    linear, counts = (
        LinearSolution(np.zeros_like(R), R, state.approach, state.states),
        Counts(),
    )
    for sweep in range(sweeps):
        goal = forcing * scale * (5 if sweep < 8 else 1)
        spent = _solve_on_set(state, linear, tangent, control, goal)
        counts += Counts(cg=spent, most_cg=spent, sweeps=1)
        changed = _predict_states(problem, state, linear, control)
        if changed <= UNSETTLED * forcing * int((linear.states != APART).sum()):
            break
    linear.step = _to_base(problem, linear.step)
    return linear, counts


def _to_base(problem: Problem, step: FloatArray) -> FloatArray:
    """The step on all levels, given it on the upper ones, below which no force acts."""
    levels = len(step)
    if levels == len(problem.block.layers) + 1:
        return step
    return np.concatenate([step, extend_to_base(problem.factor, step[-1], levels)])


def _elastic_solve(
    problem: Problem,
    r: FloatArray,
    states: States,
    target: FloatArray,
    load: float | None,
    tolerance: float,
    start: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, float]:
    """(z, forces, d): K_elastic z = r - forces, where z moves the contact down by
    `target` + d.
    """
    spectrum = eliminate(problem.factor, r)
    descent = top_descent(problem.factor, spectrum)
    forces, approach = solve_contact_forces(
        problem.factor.surface,
        target - descent,
        states == ELASTIC,
        load,
        start,
        tolerance,
    )
    return substitute(problem.factor, spectrum, forces), forces, approach


def precondition(
    tangent: Tangent,
    sweeps: Smoother | None,
    R: FloatArray,
    missing: float | None,
    states: States,
) -> tuple[FloatArray, FloatArray, float]:
    """(z, K z, its part of the approach) of the reaction R and of the load `missing`.
    If the load is None, the approach is prescribed.
    """
    problem, contact, remaining = (
        tangent.problem,
        states == ELASTIC,
        unbalanced(R, states),
    )
    swept = np.empty(0)
    if sweeps is not None:
        swept = sweeps.smooth(remaining)
        sweeps.add_product(-1.0, swept, remaining)
        problem.without_base(remaining)
        if missing is not None:
            missing -= float(remaining[0, ..., 2][contact].sum())
        remaining[0, ..., 2][contact] = 0
    still = np.zeros(states.shape)
    z, forces, approach = _elastic_solve(
        problem, remaining, states, still, missing, 1e-6
    )
    remaining[0, ..., 2] -= forces  # the elastic product of z
    excess = tangent.excess(z, remaining)
    stiff = np.add(remaining, excess, out=remaining)
    if sweeps is not None:
        swept -= sweeps.smooth(excess, transposed=True)
        sweeps.add(swept, z)
        sweeps.add_product(1.0, swept, stiff)
        problem.without_base(stiff)
    return z, stiff, approach


def _solve_on_set(
    state: State,
    linear: LinearSolution,
    tangent: Tangent,
    control: Control,
    goal: float,
) -> int:
    """Solve on the present contact set, in place, to a residual of `goal` in N; the
    iterations.
    """
    problem, states, R = tangent.problem, linear.states, linear.reaction
    load = control.load
    if load is not None:
        load -= problem.capped_load(states)
    offset = 0.0 if load is not None else control.approach
    target = (
        problem.heights
        + offset
        + state.displacement[0, ..., 2]
        + linear.step[0, ..., 2]
    )
    # R still contains the contact forces, so this solve finds the whole of them again.
    start = np.where(states == ELASTIC, R[0, ..., 2], 0.0)
    accuracy = max(1e-11, 1e-4 * goal / max(goal, norm(R, problem.workers)))
    z, forces, d = _elastic_solve(problem, R, states, target, load, accuracy, start)
    R[0, ..., 2] -= forces  # the elastic product of z
    np.negative(tangent.excess(z, R), out=R)
    R[0, ..., 2] += forces
    linear.step += z
    del z
    linear.approach = d + offset
    return 1 + _conjugate_gradients(linear, tangent, control, goal)


def _conjugate_gradients(
    linear: LinearSolution, tangent: Tangent, control: Control, goal: float
) -> int:
    """Iterate on the levels that flow until the residual is below `goal`; the
    iterations.
    """
    problem, states = tangent.problem, linear.states
    workers, R = problem.workers, linear.reaction[: tangent.levels]
    sweeps, step, spent = None, np.zeros_like(R), 0
    p = Kp = np.empty(0)
    p_approach = rho_before = 0.0
    while spent < 400:
        missing = problem.missing_load(R, states, control)
        size = unbalanced_norm(R, states, workers) + abs(missing)
        if size <= goal:
            break
        if spent == 0 and tangent.smoothed and goal < WORTH_SMOOTHING * size:
            sweeps = Smoother(tangent.rows, states == ELASTIC, workers)
        asked = None if control.load is None else missing
        z, Kz, d = precondition(tangent, sweeps, R, asked, states)
        rho = (
            dot(unbalanced(R[:1], states), z[:1])
            + dot(R[1:], z[1:], workers)
            + missing * d
        )
        if spent == 0:
            p, Kp, p_approach = z, Kz, d
        else:
            beta = rho / rho_before
            xpay(p, beta, z, workers)
            xpay(Kp, beta, Kz, workers)
            p_approach = d + beta * p_approach
        alpha = rho / dot(p, Kp, workers)
        axpy(step, alpha, p, workers)
        axpy(R, -alpha, Kp, workers)
        linear.approach += alpha * p_approach
        rho_before = rho
        spent += 1
    if spent:
        total = linear.step
        total += (_to_base(problem, step) if len(step) < len(total) else step)[
            : len(total)
        ]
    return spent


def _predict_states(
    problem: Problem, state: State, linear: LinearSolution, control: Control
) -> int:
    """Give the solution the contact states that it asks for; the number of those that
    change.
    """
    R, states = linear.reaction, linear.states
    forces = problem.contact_forces(states, R[0, ..., 2])
    g = problem.gap(state.displacement[:1] + linear.step[:1], linear.approach)
    g[states == ELASTIC] = 0
    stiffness = 1.0 / float(problem.factor.surface.min())
    load = control.load if problem.capped else None
    new = linear.states = predicted_states(forces, g, problem.cap, stiffness, load)
    R[0, ..., 2] += problem.capped_forces(states) - problem.capped_forces(new)
    return int((new != states).sum())
