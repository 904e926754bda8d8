"""The contact problem of the body whose material's tangent is frozen.

Equality-constrained solves on a guessed contact set, which then changes until its forces press
and its gaps are open (a primal-dual active set).  The solves are conjugate gradients in the null
space of the constraints.  Their preconditioner is the elastic flat block with the same
constraints met exactly (a constraint preconditioner; Gould, Hribar and Nocedal 2001), between two
sweeps over the flowing nodes (`smoother`), which see the slip lines that the elastic block does
not.  Without the sweeps, iterations grow as the flowing zones gain elements.

On the flat block the elastic stiffness times a preconditioned residual is that residual, so a
product with the tangent touches the flowing elements only; and once the first elastic solve has
met all other forces, residuals live on the levels that flow, and the iteration is cut off there.

The signs are those of `problem`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray
from fem_check import plasticity
from fem_check.contact import States, predicted_states, press
from fem_check.linear_solver import continued, eliminate, substitute, top_descent
from fem_check.plasticity import Softening
from fem_check.problem import Control, Counts, Problem, State, release_base, split_residual
from fem_check.smoother import Rows, Smoother, assemble, flowing_levels, smoother
from fem_check.vectors import add, dot, follow, norm

#: The contact set counts as settled when its changes, as a share of the contact, are below this
#: share of the reduction that the linear solve aims at: the next iteration moves more than that.
#: What a wrong node leaves shows in the residuals of tension and penetration.
UNSETTLED = 0.1

#: Solves that reduce the residual by less than this are over before the sweeps' matrix is made.
WORTH_SWEEPING = 0.1


@dataclass(frozen=True)
class Tangent:
    """The frozen body: elastic, softened where it flows, but for a share `blend`."""

    problem: Problem
    softening: Softening | None
    blend: float = 0.0

    @property
    def flows(self) -> bool:
        """Whether any element is softer than elastic."""
        return self.softening is not None and self.softening.which.size > 0

    @cached_property
    def levels(self) -> int:
        """How many levels of nodes, from the top, residuals live on after an elastic solve."""
        every = len(self.problem.block.layers) + 1
        if not self.problem.flat or self.softening is None:
            return every
        return min(flowing_levels(self.softening, self.problem.block.shape), every)

    @cached_property
    def rows(self) -> Rows:
        """Its matrix where it flows."""
        assert self.softening is not None
        problem = self.problem
        return assemble(
            problem.block.shape, problem.bricks, problem.law, self.softening, 1 - self.blend
        )

    def product(self, v: FloatArray, elastic: FloatArray) -> FloatArray:
        """The stiffness times `v`; `elastic` is the flat block's elastic product."""
        problem = self.problem
        if problem.flat:
            out = elastic.copy()
        else:
            out = np.empty_like(v)
            plasticity.elastic_force(v.reshape(-1, 3), problem.bricks, problem.law,
                                     out.reshape(-1, 3))  # fmt: skip
        if self.softening is not None and self.flows:
            plasticity.soften(v.reshape(-1, 3), problem.bricks, self.softening, 1 - self.blend,
                              out.reshape(-1, 3))  # fmt: skip
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


def _preconditioned(
    tangent: Tangent, sweeps: Smoother | None, r: FloatArray, missing: float | None, states: States
) -> tuple[FloatArray, FloatArray, float]:
    """(z, K z, approach) for the residual `r`, zero on the contact, and the `missing` load."""
    problem, contact, left = tangent.problem, states == ELASTIC, r.copy()
    swept = np.empty(0)
    if sweeps is not None:
        swept = sweeps.before(r)
        sweeps.add_product(-1.0, swept, left)
        release_base(problem, left)
        if missing is not None:
            missing -= float(left[0, ..., 2][contact].sum())
        left[0, ..., 2][contact] = 0
    z, forces, approach = _elastic_solve(
        problem, left, states, np.zeros(states.shape), missing, 1e-6
    )
    left[0, ..., 2] -= forces
    stiff = tangent.product(z, left)
    if sweeps is not None:
        swept += sweeps.after(np.subtract(left, stiff, out=left))
        sweeps.add(swept, z)
        sweeps.add_product(1.0, swept, stiff)
        release_base(problem, stiff)
    return z, stiff, approach


@dataclass
class Linear:
    """The linearised contact problem while it is solved."""

    step: FloatArray
    R: FloatArray
    approach: float
    states: States


def _solve_on_set(
    state: State, linear: Linear, tangent: Tangent, control: Control, goal: float, counts: Counts
) -> None:
    """Solves the linear body on the present contact set to a residual of `goal`, in N."""
    problem, states = tangent.problem, linear.states
    capped = problem.cap * (states == PLASTIC) if np.isfinite(problem.cap) else None
    load = control.load
    if load is not None and capped is not None:
        load -= float(capped.sum())
    offset = 0.0 if load is not None else control.approach
    wanted = problem.heights + offset + state.displacement[0, ..., 2] + linear.step[0, ..., 2]
    # All of the contact force is sought anew, so R goes in as it stands.
    start = np.where(states == ELASTIC, linear.R[0, ..., 2], 0.0)
    z, forces, d = _elastic_solve(problem, linear.R, states, wanted, load, 1e-11, start)
    linear.approach = d + offset
    linear.step += z
    elastic = linear.R.copy()
    elastic[0, ..., 2] -= forces
    linear.R -= tangent.product(z, elastic)
    counts.cg += 1
    spent = 1 + _conjugate_gradients(linear, tangent, control, goal)
    counts.cg += spent - 1
    counts.largest_cg = max(counts.largest_cg, spent)


def _conjugate_gradients(linear: Linear, tangent: Tangent, control: Control, goal: float) -> int:
    """Iterates on the levels that flow until the residual is below `goal`; returns how often."""
    problem, states, levels = tangent.problem, linear.states, tangent.levels
    R, spent, rho_before = linear.R[:levels], 0, 0.0
    sweeps, step = None, np.zeros_like(R)
    p = Kp = np.empty(0)
    approach = 0.0
    while spent < 400:
        r, missing, _ = split_residual(problem, R, states, control)
        found = norm(r) + abs(missing)
        if found <= goal:
            break
        if spent == 0 and problem.flat and tangent.flows and goal < WORTH_SWEEPING * found:
            sweeps = smoother(tangent.rows, states == ELASTIC)
        z, Kz, d = _preconditioned(
            tangent, sweeps, r, None if control.load is None else missing, states
        )
        rho = dot(r, z) + missing * d
        if spent == 0:
            p, Kp, approach = z, Kz, d
        else:
            beta = rho / rho_before
            follow(p, beta, z)
            follow(Kp, beta, Kz)
            approach = d + beta * approach
        alpha = rho / dot(p, Kp)
        add(step, alpha, p)
        add(R, -alpha, Kp)
        linear.approach += alpha * approach
        rho_before = rho
        spent += 1
    if spent > 0:
        linear.step[:levels] += step
        if levels < len(linear.step):
            linear.step[levels:] += continued(problem.factor, step[-1], levels)
    return spent


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
    linear = Linear(np.zeros_like(right), right.copy(), state.approach, state.states)
    _solve_on_set(state, linear, Tangent(problem, softening), control, goal, counts)
    return linear.step


def linear_contact(
    state: State,
    R: FloatArray,
    tangent: Tangent,
    control: Control,
    effort: tuple[float, int],
    counts: Counts,
) -> Linear:
    """Solves the contact problem of the body with a frozen `tangent`, to `effort`: the
    reduction of the residual, and the most changes of the contact set."""
    forcing, sweeps = effort
    problem = tangent.problem
    linear = Linear(np.zeros_like(R), R.copy(), state.approach, state.states)
    stiffness = 1.0 / float(problem.factor.surface.min())
    r, r_d, _ = split_residual(problem, R, state.states, control)
    scale = max(norm(r) + abs(r_d), 1e-300)
    for sweep in range(sweeps):
        tight = sweep >= 8
        goal = forcing * scale * (1 if tight else 5)
        _solve_on_set(state, linear, tangent, control, goal, counts)
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


def _change_caps(problem: Problem, linear: Linear, new: States) -> None:
    """Moves the capped forces in R to the new states."""
    if np.isfinite(problem.cap):
        before, after = linear.states == PLASTIC, new == PLASTIC
        linear.R[0, ..., 2] += problem.cap * (before.astype(float) - after.astype(float))


def _states_of(problem: Problem, state: State, linear: Linear, stiffness: float) -> States:
    """The states that the linear solution asks for."""
    u, states = state.displacement, linear.states
    forces = np.where(states == ELASTIC, linear.R[0, ..., 2], 0.0)
    if np.isfinite(problem.cap):
        forces = np.where(states == PLASTIC, problem.cap, forces)
    gap = -(u[0, ..., 2] + linear.step[0, ..., 2]) - problem.heights - linear.approach
    gap[states == ELASTIC] = 0
    return predicted_states(forces, gap, problem.cap, stiffness)
