"""The finite-element contact problem: its data, its unknowns, and the residuals of a state.

A contact force F presses down, so the body feels -F.  The *reaction* is R = -(internal force)
- (forces of the capped nodes): on the contact nodes of a solution it equals the contact force, and
everywhere else it vanishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray
from fem_check import plasticity
from fem_check.contact import States
from fem_check.element import Elements
from fem_check.linear_solver import Factor
from fem_check.mesh import PeriodicBlock
from fem_check.plasticity import History, Law
from fem_check.smoother import layer_stiffness
from fem_check.workers import ALONE, Workers, norm


@dataclass(frozen=True)
class Problem:
    """The data that do not change along a load path.

    bricks: the elements of the true geometry, which is the factor's if `flat`.  heights: (nx, ny)
    of the top, in m.  cap: the largest nodal force, in N.
    """

    block: PeriodicBlock
    bricks: Elements
    factor: Factor
    law: Law
    heights: FloatArray
    cap: float = np.inf
    flat: bool = True
    workers: Workers = ALONE

    @cached_property
    def stiffness(self) -> tuple[FloatArray, FloatArray]:
        """The stiffness of the flat block's layers, as the smoother needs it."""
        return layer_stiffness(self.bricks, self.law)

    @property
    def plastic(self) -> bool:
        """True if the material can flow."""
        return bool(np.isfinite(self.law.yield_stress))

    @property
    def capped(self) -> bool:
        """True if the nodal forces have an upper bound."""
        return bool(np.isfinite(self.cap))


@dataclass(frozen=True)
class Control:
    """The prescribed total force `load` in N or, where that is None, the `approach` in m.

    scale: the path's largest force so far, in N.
    """

    load: float | None = None
    approach: float = 0.0
    scale: float = 0.0


@dataclass(frozen=True)
class State:
    """Displacement (nz + 1, nx, ny, 3), approach, contact states and nodal forces (nx, ny)."""

    displacement: FloatArray
    approach: float
    states: States
    forces: FloatArray


@dataclass(frozen=True)
class Counts:
    """Iterations of one increment, or the sum of several.

    most_newton and most_cg are the largest numbers in one increment and in one linear solve.
    """

    newton: int = 0
    cg: int = 0
    sweeps: int = 0
    line_searches: int = 0
    most_newton: int = 0
    most_cg: int = 0
    increments: int = 0
    halvings: int = 0

    def __add__(self, other: Counts) -> Counts:
        mine, others = vars(self), vars(other)
        most = {n: max(mine[n], others[n]) for n in mine if n.startswith("most")}
        return Counts(**{n: mine[n] + others[n] for n in mine} | most)


def internal_force(
    problem: Problem, u: FloatArray, history: History | None
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The internal force of the displacement `u`, of the same shape, and which elements flow.

    Without a history the body is elastic.
    """
    past = history if problem.plastic else None
    force, flowing = plasticity.internal_force(
        u.reshape(-1, 3), problem.bricks, problem.law, past, problem.workers
    )
    return force.reshape(u.shape), flowing


def gap(problem: Problem, u: FloatArray, approach: float) -> FloatArray:
    """(nx, ny) gap between the top and the flat, in m."""
    return np.asarray(-u[0, ..., 2] - problem.heights - approach)


def without_base(problem: Problem, force: FloatArray) -> FloatArray:
    """The force, in place without the reactions of the base, if it reaches the base at all."""
    if len(force) > len(problem.block.layers):
        force[-1, ..., 2 if problem.block.sliding else 0 :] = 0
    return force


def layer_stresses(
    problem: Problem, state: State, history: History, layer: int
) -> tuple[FloatArray, Elements]:
    """(nx ny, 6, 8) stresses of a layer, and its elements; those of all would fill the memory."""
    size, bricks = problem.heights.size, problem.bricks
    part = slice(layer * size, (layer + 1) * size)
    some = bricks._replace(connectivity=bricks.connectivity[part], shape_of=bricks.shape_of[part])
    past = history._replace(rows=history.rows[part]) if problem.plastic else None
    u = state.displacement.reshape(-1, 3)
    return plasticity.stresses(u, some, problem.law, past), some


def reaction(problem: Problem, states: States, internal: FloatArray) -> FloatArray:
    """R as the module's docstring defines it."""
    R = without_base(problem, -internal)
    if problem.capped:
        R[0, ..., 2] -= problem.cap * (states == PLASTIC)
    return R


def contact_forces(problem: Problem, states: States, pressing: FloatArray) -> FloatArray:
    """(nx, ny) contact forces: `pressing` where the contact is elastic, and the cap."""
    forces = np.where(states == ELASTIC, pressing, 0.0)
    return np.where(states == PLASTIC, problem.cap, forces) if problem.capped else forces


def missing_load(problem: Problem, R: FloatArray, states: States, control: Control) -> float:
    """The prescribed load less the contact forces, in N; 0 where the approach is prescribed."""
    if control.load is None:
        return 0.0
    total = float(R[0, ..., 2][states == ELASTIC].sum())
    if problem.capped:
        total += problem.cap * float((states == PLASTIC).sum())
    return control.load - total


def unbalanced(R: FloatArray, states: States) -> FloatArray:
    """R without the contact forces."""
    R = R.copy()
    R[0, ..., 2][states == ELASTIC] = 0
    return R


def unbalanced_norm(R: FloatArray, states: States, workers: Workers = ALONE) -> float:
    """The norm of `unbalanced`, without a copy of all its levels."""
    return math.hypot(norm(unbalanced(R[:1], states)), norm(R[1:], workers))


def residuals(problem: Problem, state: State, R: FloatArray, control: Control) -> dict[str, float]:
    """Dimensionless residuals of a state with the reaction R.

    Forces are divided by the total force, or by the path's largest where that is larger: balance,
    the norm of the unbalanced nodal forces; load, the missing load; tension, the largest pull of a
    contact node.  Lengths are divided by the rms height, or by the uniform compression of a flat
    surface: gap, the largest on the elastic contact; penetration, the deepest node elsewhere.
    """
    contact, capped = state.states == ELASTIC, state.states == PLASTIC
    forces = np.where(contact, R[0, ..., 2], 0.0)
    pressed = float(forces.sum()) + (problem.cap * int(capped.sum()) if capped.any() else 0.0)
    # Where nothing has ever pressed, all forces are exactly zero.
    total = max(control.scale, pressed) or 1.0
    uniform = total / problem.heights.size * float(problem.factor.surface[0, 0])
    rms = float(np.std(problem.heights)) or uniform
    g = gap(problem, state.displacement, state.approach)
    apart, below = -g[state.states == APART], g[capped]
    return {
        "balance": unbalanced_norm(R, state.states, problem.workers) / total,
        "load": abs(missing_load(problem, R, state.states, control)) / total,
        "gap": float(np.abs(g[contact]).max(initial=0.0)) / rms,
        "penetration": float(max(apart.max(initial=0.0), below.max(initial=0.0))) / rms,
        "tension": float((-forces[contact]).max(initial=0.0)) / total,
    }
