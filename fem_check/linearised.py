"""The contact problem of a body with a frozen material tangent.

A primal-dual active set method solves the equalities on a guessed contact set, then
changes the set until forces press and gaps are open.  The solves are conjugate
gradients in the null space of the constraints.  Their preconditioner is the elastic
flat block with the same constraints met exactly (a constraint preconditioner; Gould,
Hribar and Nocedal 2001), between two sweeps over the flowing nodes (`smoother`).

On the flat block, the elastic stiffness times a preconditioned residual is that
residual, so that a product with the tangent needs the flowing elements only.  After an
elastic solve all residuals are on the levels of nodes that flow: the solves work on
these levels alone, and the step is continued to the base once.  Signs are those of
`problem`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from epcontact.results import APART, ELASTIC, FloatArray
from fem_check import plasticity
from fem_check.contact import States, predict_states, solve_contact_forces
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
from fem_check.smoother import FlowRows, Smoother, assemble_rows
from fem_check.workers import axpy, dot, norm, xpay

#: The contact set is accepted when the fraction of its nodes that still change is below
#: this factor times `forcing`, because the next Newton iteration moves more nodes.  A
#: node in the wrong set shows in the residuals of tension and penetration: this factor
#: affects the work and not the solution.
UNSETTLED = 0.1
#: Levels are left out of a linear solve if the norm of their residual is below this
#: fraction of the solve's goal.
NEGLIGIBLE = 0.01
#: A solve whose goal is above this fraction of its residual takes so few iterations
#: that a smoother does not pay.
SMOOTHING_GOAL = 0.1
#: Iterations of conjugate gradients after which a linear solve is given up; the next
#: Newton iteration goes on from its result.
MAX_ITERATIONS = 400


@dataclass(frozen=True)
class Tangent:
    """The stiffness of the frozen body.

    Attributes:
        problem: the problem.
        correction: consistent tangent less elastic stiffness; None: nothing flows.
        blend: fraction of the correction that is left out.
    """

    problem: Problem
    correction: TangentCorrection | None
    blend: float = 0.0

    @cached_property
    def levels(self) -> int:
        """Number of levels, from the top, with a residual after an elastic solve."""
        all_levels = len(self.problem.block.layers) + 1
        if not self.problem.flat:
            return all_levels
        if self.correction is None:
            return 1
        deepest = int(self.correction.elements.max(initial=0))
        layer = deepest // self.problem.heights.size
        # The nodes of the deepest flowing elements, and their neighbours below.
        return min(layer + 3, all_levels)

    def levels_with(self, R: FloatArray, norm_below: float) -> int:
        """Return the number of upper levels that a linear solve needs.

        Below these levels no element flows, and the norm of the reaction is at most
        `norm_below`.

        Args:
            R: (levels, nx, ny, 3) reaction (residual force and contact force), in N.
            norm_below: in N.
        """
        below = 0.0
        for level in range(len(R) - 1, self.levels - 1, -1):
            below = math.hypot(below, norm(R[level], self.problem.workers))
            if below > norm_below:
                return level + 1
        return self.levels

    @property
    def smoothed(self) -> bool:
        """True if some element flows, and its rows can be assembled."""
        if self.correction is None:
            return False
        return self.correction.elements.size > 0 and self.problem.flat

    @cached_property
    def rows(self) -> FlowRows:
        """The tangent's matrix rows of the flowing nodes, for Gauss-Seidel sweeps.

        They need a correction: the body must flow somewhere.
        """
        assert self.correction is not None
        return assemble_rows(self.problem, self.correction, 1 - self.blend)

    def excess(self, v: FloatArray, elastic: FloatArray) -> FloatArray:
        """Return the frozen body's stiffness times v, beyond that of the flat block.

        Args:
            v: (levels, nx, ny, 3) unknown displacements, in m, which the stiffness
                multiplies.
            elastic: (levels, nx, ny, 3) elastic stiffness of the flat block times v, in
                N.

        Returns:
            (levels, nx, ny, 3) forces in N, with zeros where the base holds the nodes.
        """
        problem = self.problem
        excess = np.zeros_like(v)
        if self.correction is not None and self.correction.elements.size:
            plasticity.add_correction(
                problem.physical_displacement(v).reshape(-1, 3),
                problem.bricks,
                self.correction,
                1 - self.blend,
                excess.reshape(-1, 3),
                problem.workers,
            )
            problem.force_on_unknowns(excess)
        if not problem.flat:
            excess += problem.internal_force(v, None)[0] - elastic
        return problem.clear_base(excess)


@dataclass
class LinearSolution:
    """The solution of a linearised contact problem.

    Attributes:
        step: (levels, nx, ny, 3) change of the displacement, in m.
        reaction: (levels, nx, ny, 3) R that remains after the step, in N.
        approach: of the flat, in m.
        states: (nx, ny) contact states.
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
    max_sweeps: int = 12,
) -> tuple[LinearSolution, Counts]:
    """Solve the contact problem of a body with a frozen tangent.

    Args:
        state: state at which the tangent was computed.
        R: (nz + 1, nx, ny, 3) reaction of the state, in N.
        tangent: of the frozen body.
        control: prescribed load or approach.
        forcing: factor by which each solve reduces the residual.
        max_sweeps: largest number of contact sets that are tried.

    Returns:
        The solution, whose step reaches the base, and the numbers of iterations.
    """
    problem = tangent.problem
    missing = problem.missing_load(R, state.states, control)
    balance = unbalanced_norm(R, state.states, problem.workers)
    scale = max(balance + abs(missing), 1e-300)
    # Contact forces that are in balance up to rounding have no direction to improve.
    rounding = 8 * np.finfo(float).eps * float(np.abs(state.forces).sum())
    R = R[: tangent.levels_with(R, NEGLIGIBLE * forcing * scale)].copy()
    linear = LinearSolution(np.zeros_like(R), R, state.approach, state.states)
    counts = Counts()
    for sweep in range(max_sweeps):
        goal = max(forcing * scale, rounding)
        if sweep < 8:
            goal *= 5  # the first contact sets do not deserve an accurate solve
        iterations = _solve_on_set(state, linear, tangent, control, goal)
        counts += Counts(cg=iterations, most_cg=iterations, sweeps=1)
        changed = _update_states(problem, state, linear, control)
        if changed <= UNSETTLED * forcing * int((linear.states != APART).sum()):
            break
    linear.step = _to_base(problem, linear.step)
    return linear, counts


def _to_base(problem: Problem, step: FloatArray) -> FloatArray:
    """Return a step on all levels down to the base, from a step on the upper levels.

    No force acts below the upper levels.

    Args:
        problem: the finite-element problem, with nz + 1 levels.
        step: (levels, nx, ny, 3) displacements of the upper levels, in m.

    Returns:
        (nz + 1, nx, ny, 3) displacements in m; `step` itself if it has all levels.
    """
    levels = len(step)
    if levels == len(problem.block.layers) + 1:
        return step
    return np.concatenate([step, extend_to_base(problem.factor, step[-1], levels)])


def _elastic_solve(
    problem: Problem,
    force: FloatArray,
    states: States,
    target: FloatArray,
    load: float | None,
    tolerance: float,
    start: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, float]:
    """Solve the elastic contact problem K z = force - contact forces, on a contact set.

    Args:
        problem: the finite-element problem, whose elastic flat block has the stiffness
            K.
        force: (levels, nx, ny, 3) on the upper levels, in N.
        states: (nx, ny); ELASTIC nodes are in the contact set.
        target: (nx, ny) displacement in m by which the contact nodes move down, less
            the approach.
        load: sum of the contact forces, in N; None: the approach is 0.
        tolerance: factor by which the residual is reduced.
        start: (nx, ny) first guess of the contact forces in N; None: no forces.

    Returns:
        z: (levels, nx, ny, 3) displacements, in m.
        contact_forces: (nx, ny) downward, in N.
        approach: in m.
    """
    spectrum = eliminate(problem.factor, force)
    descent = top_descent(problem.factor, spectrum)
    contact_forces, approach = solve_contact_forces(
        problem.factor.surface,
        target - descent,
        states == ELASTIC,
        load,
        start,
        tolerance,
    )
    z = substitute(problem.factor, spectrum, contact_forces)
    return z, contact_forces, approach


def precondition(
    tangent: Tangent,
    smoother: Smoother | None,
    R: FloatArray,
    missing: float | None,
    states: States,
) -> tuple[FloatArray, FloatArray, float]:
    """Apply the preconditioner to a residual, and the tangent to the result.

    Args:
        tangent: of the frozen body.
        smoother: sweeps before and after the elastic solve; None: no sweeps.
        R: (levels, nx, ny, 3) reaction (residual force and contact force), in N.
        missing: load that is missing, in N; None: the approach is prescribed.
        states: (nx, ny) contact states.

    Returns:
        z: (levels, nx, ny, 3) preconditioned residual, in m.
        stiff: (levels, nx, ny, 3) the tangent times z, in N.
        approach: that belongs to z, in m.
    """
    problem = tangent.problem
    contact = states == ELASTIC
    remaining = unbalanced(R, states)
    swept = np.empty(0)
    if smoother is not None:
        swept = smoother.smooth(remaining)
        smoother.add_product(-1.0, swept, remaining)
        problem.clear_base(remaining)
        if missing is not None:
            missing -= float(remaining[0, ..., 2][contact].sum())
        remaining[0, ..., 2][contact] = 0
    target = np.zeros(states.shape)
    z, forces, approach = _elastic_solve(
        problem, remaining, states, target, missing, 1e-6
    )
    remaining[0, ..., 2] -= forces  # the elastic product of z
    excess = tangent.excess(z, remaining)
    stiff = np.add(remaining, excess, out=remaining)
    if smoother is not None:
        swept -= smoother.smooth(excess, transposed=True)
        smoother.add(swept, z)
        smoother.add_product(1.0, swept, stiff)
        problem.clear_base(stiff)
    return z, stiff, approach


def _solve_on_set(
    state: State,
    linear: LinearSolution,
    tangent: Tangent,
    control: Control,
    goal: float,
) -> int:
    """Solve the linear problem on the present contact set; change `linear` in place.

    Args:
        state: state at which the tangent was computed.
        linear: present solution, whose step, reaction and approach are updated.
        tangent: of the frozen body.
        control: prescribed load or approach.
        goal: norm of the residual that suffices, in N.

    Returns:
        The number of iterations, one elastic solve included.
    """
    problem = tangent.problem
    states = linear.states
    R = linear.reaction
    load = control.load
    offset = control.approach
    if load is not None:
        load -= problem.capped_load(states)
        offset = 0.0
    upward = state.displacement[0, ..., 2]
    target = problem.heights + offset + upward + linear.step[0, ..., 2]
    # R still contains the contact forces: this solve finds all of them again.
    start = np.where(states == ELASTIC, R[0, ..., 2], 0.0)
    tolerance = max(1e-11, 1e-4 * goal / max(goal, norm(R, problem.workers)))
    z, forces, shift = _elastic_solve(
        problem, R, states, target, load, tolerance, start
    )
    R[0, ..., 2] -= forces  # the elastic product of z
    np.negative(tangent.excess(z, R), out=R)
    R[0, ..., 2] += forces
    linear.step += z
    del z  # a field, which would stay in memory during the iterations
    linear.approach = shift + offset
    return 1 + _conjugate_gradients(linear, tangent, control, goal)


def _conjugate_gradients(
    linear: LinearSolution, tangent: Tangent, control: Control, goal: float
) -> int:
    """Iterate on the levels that flow; `linear` is changed in place.

    It ends without an error after `MAX_ITERATIONS` (400).

    Args:
        linear: present solution, whose step, reaction and approach are updated.
        tangent: of the frozen body.
        control: prescribed load or approach.
        goal: norm of the residual that suffices, in N.

    Returns:
        The number of iterations.
    """
    problem = tangent.problem
    workers = problem.workers
    states = linear.states
    R = linear.reaction[: tangent.levels]
    step = np.zeros_like(R)
    smoother = None
    p = Kp = np.empty(0)
    p_approach = rho_before = 0.0
    iterations = 0
    while iterations < MAX_ITERATIONS:
        missing = problem.missing_load(R, states, control)
        size = unbalanced_norm(R, states, workers) + abs(missing)
        if size <= goal:
            break
        if iterations == 0 and tangent.smoothed and goal < SMOOTHING_GOAL * size:
            smoother = Smoother(tangent.rows, states == ELASTIC, workers)
        prescribed = None
        if control.load is not None:
            prescribed = missing
        z, Kz, z_approach = precondition(tangent, smoother, R, prescribed, states)
        rho = dot(unbalanced(R[:1], states), z[:1])
        rho += dot(R[1:], z[1:], workers)
        rho += missing * z_approach
        if iterations == 0:
            p, Kp, p_approach = z, Kz, z_approach
        else:
            beta = rho / rho_before
            xpay(p, beta, z, workers)
            xpay(Kp, beta, Kz, workers)
            p_approach = z_approach + beta * p_approach
        alpha = rho / dot(p, Kp, workers)
        axpy(step, alpha, p, workers)
        axpy(R, -alpha, Kp, workers)
        linear.approach += alpha * p_approach
        rho_before = rho
        iterations += 1
    if iterations:
        levels = len(linear.step)
        if len(step) < levels:
            step = _to_base(problem, step)[:levels]
        linear.step += step
    return iterations


def _update_states(
    problem: Problem, state: State, linear: LinearSolution, control: Control
) -> int:
    """Give the linear solution its predicted contact states, in place.

    Args:
        problem: the finite-element problem.
        state: state at which the tangent was computed.
        linear: the solution; its states and reaction are updated.
        control: prescribed load or approach.

    Returns:
        The number of nodes whose state changes.
    """
    R = linear.reaction
    states = linear.states
    forces = problem.contact_forces(states, R[0, ..., 2])
    gap = problem.gap(state.displacement[:1] + linear.step[:1], linear.approach)
    gap[states == ELASTIC] = 0
    stiffness = 1.0 / float(problem.factor.surface.min())
    load = None
    if problem.capped:
        load = control.load
    new_states = predict_states(forces, gap, problem.cap, stiffness, load)
    R[0, ..., 2] += problem.capped_forces(states) - problem.capped_forces(new_states)
    linear.states = new_states
    return int((new_states != states).sum())
