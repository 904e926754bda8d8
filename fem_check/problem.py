"""The finite-element contact problem: its data, its unknowns, and the residuals of a
state.

A contact force F presses down, so the body feels -F.  The *reaction* is R = -(internal
force)
- (forces of the capped nodes): on the contact nodes of a solution it equals the contact
  force, and everywhere else it vanishes.
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
from fem_check.workers import ALONE, Workers, norm


@dataclass(frozen=True)
class Control:
    """The prescribed total force or else approach, and the path's largest force so far,
    in N.
    """

    load: float | None = None
    approach: float = 0.0
    scale: float = 0.0


@dataclass(frozen=True)
class State:
    """Displacement (nz + 1, nx, ny, 3), approach, contact states and nodal forces (nx,
    ny).
    """

    displacement: FloatArray
    approach: float
    states: States
    forces: FloatArray


@dataclass(frozen=True)
class Counts:
    """Iterations of one increment, or the sum of several, but for the most of one of
    them.
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


def unbalanced(R: FloatArray, states: States) -> FloatArray:
    """R without the contact forces."""
    R = R.copy()
    R[0, ..., 2][states == ELASTIC] = 0
    return R


def unbalanced_norm(R: FloatArray, states: States, workers: Workers = ALONE) -> float:
    """The norm of `unbalanced`, without a copy of all its levels."""
    return math.hypot(norm(unbalanced(R[:1], states)), norm(R[1:], workers))


@dataclass(frozen=True)
class Problem:
    """The data that do not change along a load path.

    bricks: the elements of the true geometry, which is the factor's if `flat`.  heights: (nx, ny)
    of the top, in m.  cap: the largest nodal force, in N.  tilt: (nx, ny, 2) slopes of a punch, or
    None; see `turned`.
    """

    block: PeriodicBlock
    bricks: Elements
    factor: Factor
    law: Law
    heights: FloatArray
    cap: float = np.inf
    flat: bool = True
    tilt: FloatArray | None = None
    workers: Workers = ALONE

    @cached_property
    def stiffness(self) -> tuple[FloatArray, FloatArray]:
        """The stiffness of the flat block's layers, as the smoother needs it."""
        return plasticity.layer_stiffness(self.bricks, self.law)

    @property
    def plastic(self) -> bool:
        """True if the material can flow."""
        return math.isfinite(self.law.yield_stress)

    @property
    def capped(self) -> bool:
        """True if the nodal forces have an upper bound."""
        return math.isfinite(self.cap)

    def internal_force(
        self, u: FloatArray, history: History | None
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """The internal force of `u`, and which elements flow; without a history none
        does.
        """
        past, nodal = history if self.plastic else None, self.turned(u).reshape(-1, 3)
        force, flowing = plasticity.internal_force(
            nodal, self.bricks, self.law, past, self.workers
        )
        return self.turned_back(force.reshape(u.shape)), flowing

    def turned(self, v: FloatArray) -> FloatArray:
        """The displacement u of the unknowns v.  On top of a block under a punch, which
        presses along (tilt, 1) and meets what moves sideways at another height, v_z =
        u_z + tilt . u_xy.
        """
        if self.tilt is None:
            return v
        u = v.copy()
        u[0, ..., 2] -= (self.tilt * v[0, ..., :2]).sum(axis=-1)
        return u

    def turned_back(self, force: FloatArray) -> FloatArray:
        """The forces on v, in place, of those on u: the transpose of `turned`."""
        if self.tilt is not None:
            force[0, ..., :2] -= self.tilt * force[0, ..., 2:]
        return force

    def gap(self, u: FloatArray, approach: float) -> FloatArray:
        """(nx, ny) gap between the top and the flat, in m."""
        return np.asarray(-u[0, ..., 2] - self.heights - approach)

    def without_base(self, force: FloatArray) -> FloatArray:
        """The force, in place without the reactions of the base, if it reaches the base
        at all.
        """
        if len(force) > len(self.block.layers):
            force[-1, ..., 2 if self.block.sliding else 0 :] = 0
        return force

    def layer_stresses(
        self, state: State, history: History, layer: int
    ) -> tuple[FloatArray, Elements]:
        """(nx ny, 6, 8) stresses of a layer, and its elements."""
        size, bricks = self.heights.size, self.bricks
        part = slice(layer * size, (layer + 1) * size)
        some = bricks._replace(
            connectivity=bricks.connectivity[part], shape_of=bricks.shape_of[part]
        )
        past = history._replace(rows=history.rows[part]) if self.plastic else None
        u = self.turned(state.displacement).reshape(-1, 3)
        return plasticity.stresses(u, some, self.law, past), some

    def reaction(self, states: States, internal: FloatArray) -> FloatArray:
        """R as the module's docstring defines it."""
        R = self.without_base(-internal)
        R[0, ..., 2] -= self.capped_forces(states)
        return R

    def capped_forces(self, states: States) -> FloatArray:
        """(nx, ny) the cap at the capped nodes, and 0 elsewhere."""
        return np.where(states == PLASTIC, self.cap, 0.0)

    def contact_forces(self, states: States, pressing: FloatArray) -> FloatArray:
        """(nx, ny) contact forces: `pressing` where the contact is elastic, and the
        cap.
        """
        return np.where(states == ELASTIC, pressing, self.capped_forces(states))

    def capped_load(self, states: States) -> float:
        """The force in N that the capped nodes carry."""
        count = int((states == PLASTIC).sum())
        return self.cap * count if count else 0.0

    def missing_load(self, R: FloatArray, states: States, control: Control) -> float:
        """The prescribed load less the contact forces, in N; 0 where the approach is
        prescribed.
        """
        if control.load is None:
            return 0.0
        total = float(R[0, ..., 2][states == ELASTIC].sum()) + self.capped_load(states)
        return control.load - total

    def residuals(
        self, state: State, R: FloatArray, control: Control
    ) -> dict[str, float]:
        """Dimensionless residuals of a state with the reaction R.

        Over the total force, or the path's largest where that is larger: balance, the
        norm of the unbalanced nodal forces; load, the missing load; tension, the
        largest pull of a contact node.  Over the rms height, or the uniform compression
        of a flat surface: gap, the largest on the elastic contact; penetration, the
        deepest node elsewhere.
        """
        contact = state.states == ELASTIC
        forces = np.where(contact, R[0, ..., 2], 0.0)
        pressed = float(forces.sum()) + self.capped_load(state.states)
        # Where nothing has ever pressed, all forces are exactly zero.
        total = max(control.scale, pressed) or 1.0
        uniform = total / self.heights.size * float(self.factor.surface[0, 0])
        rms = float(np.std(self.heights)) or uniform
        g = self.gap(state.displacement, state.approach)
        apart, below = -g[state.states == APART], g[state.states == PLASTIC]
        return {
            "balance": unbalanced_norm(R, state.states, self.workers) / total,
            "load": abs(self.missing_load(R, state.states, control)) / total,
            "gap": float(np.abs(g[contact]).max(initial=0.0)) / rms,
            "penetration": float(max(apart.max(initial=0.0), below.max(initial=0.0)))
            / rms,
            "tension": float((-forces[contact]).max(initial=0.0)) / total,
        }
