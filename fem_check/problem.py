"""The finite-element contact problem: its data, its unknowns, and its residuals.

A contact force F presses down, so that the body feels -F.  The *reaction* is

    R = -(internal force) - (forces of the capped nodes).

In a solution it equals the contact force on the elastic contact nodes, and vanishes
everywhere else.
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
from fem_check.plasticity import History, J2Law
from fem_check.workers import SERIAL, Workers, norm


@dataclass(frozen=True)
class Control:
    """What an increment prescribes.

    Attributes:
        load: total force, in N; None: the approach is prescribed.
        approach: of the flat in m, if no load is prescribed.
        scale: largest force of the path so far, in N, which normalises residuals.
    """

    load: float | None = None
    approach: float = 0.0
    scale: float = 0.0


@dataclass(frozen=True)
class State:
    """The unknowns of the problem.

    Attributes:
        displacement: (nz + 1, nx, ny, 3) in m; under a punch it has to be converted by
            `Problem.physical_displacement`.
        approach: d of the flat, in m.
        states: (nx, ny) contact states of the top nodes.
        forces: (nx, ny) downward contact forces, in N.
    """

    displacement: FloatArray
    approach: float
    states: States
    forces: FloatArray


@dataclass(frozen=True)
class Counts:
    """Iterations of one increment, or of several increments, which are added by `+`.

    Attributes:
        newton: Newton iterations.
        cg: iterations of conjugate gradients.
        sweeps: linear solves, one for each contact set.
        line_searches: times that a Newton step was shortened.
        most_newton: largest number of Newton iterations of an increment.
        most_cg: largest number of iterations of a linear solve.
        increments: converged increments.
        halvings: times that an increment was halved.
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
        """Return the sum of two counts of iterations.

        The fields that begin with `most` get the larger value, all others the sum.
        """
        total = {}
        for name, count in vars(self).items():
            other_count = vars(other)[name]
            total[name] = count + other_count
            if name.startswith("most"):
                total[name] = max(count, other_count)
        return Counts(**total)


def unbalanced(R: FloatArray, states: States) -> FloatArray:
    """Return the reaction R without the contact forces, as a copy.

    Args:
        R: (levels, nx, ny, 3) reaction in N; on ELASTIC top nodes its z component is
            the contact force, which is set to 0.
        states: (nx, ny) contact states of the top nodes.
    """
    R = R.copy()
    R[0, ..., 2][states == ELASTIC] = 0
    return R


def unbalanced_norm(R: FloatArray, states: States, workers: Workers = SERIAL) -> float:
    """Return the Euclidean norm of the unbalanced nodal forces, in N.

    Args:
        R: (levels, nx, ny, 3) reaction in N; the z component on ELASTIC top nodes is a
            contact force and is left out.
        states: (nx, ny) contact states of the top nodes.
        workers: threads that share the work.
    """
    return math.hypot(norm(unbalanced(R[:1], states)), norm(R[1:], workers))


@dataclass(frozen=True)
class Problem:
    """The data that do not change along a load path.

    Attributes:
        block: the periodic block.
        bricks: the elements of the true geometry.
        factor: of the elastic block with a flat top.
        law: of the material.
        heights: (nx, ny) roughness of the top, in m.
        cap: largest nodal force, in N; may be infinite.
        flat: whether the factor is that of the true geometry under a flat.
        tilt: (nx, ny, 2) slopes of a punch; None: the flat is even.
        workers: threads that share the work.
    """

    block: PeriodicBlock
    bricks: Elements
    factor: Factor
    law: J2Law
    heights: FloatArray
    cap: float = np.inf
    flat: bool = True
    tilt: FloatArray | None = None
    workers: Workers = SERIAL

    @cached_property
    def stiffness(self) -> tuple[FloatArray, FloatArray]:
        """Element stiffness of the problem's layers, from `plasticity.layer_stiffness`.

        The elastic part is (shapes, 24 * 24) in N/m, the deviatoric one (shapes, 8, 24
        * 24) in m.
        """
        return plasticity.layer_stiffness(self.bricks, self.law)

    @property
    def plastic(self) -> bool:
        """True if the problem's material can flow: its yield stress is finite."""
        return math.isfinite(self.law.yield_stress)

    @property
    def may_flow_freely(self) -> bool:
        """True if the problem's material flows at a bounded yield stress."""
        return self.plastic and self.law.saturates

    @property
    def capped(self) -> bool:
        """True if the problem's nodal contact forces have an upper bound."""
        return math.isfinite(self.cap)

    @property
    def area(self) -> float:
        """Nominal area of the block's top, in m^2."""
        return self.block.node_area * self.heights.size

    def internal_force(
        self, v: FloatArray, history: History | None
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the internal force of the elements, and the elements that flow.

        Args:
            v: (nz + 1, nx, ny, 3) unknown displacements, in m.
            history: plastic strains of the elements; None: nothing flows.

        Returns:
            force: (nz + 1, nx, ny, 3) on the unknowns, in N.
            flowing: (m,) True for the elements that flow.
        """
        if not self.plastic:
            history = None
        u = self.physical_displacement(v).reshape(-1, 3)
        force, flowing = plasticity.internal_force(
            u, self.bricks, self.law, history, self.workers
        )
        return self.force_on_unknowns(force.reshape(v.shape)), flowing

    def physical_displacement(self, v: FloatArray) -> FloatArray:
        """Return the displacement u of the unknowns v, both (levels, nx, ny, 3) in m.

        A punch presses along its normal (tilt, 1), and a node that moves sideways meets
        it at another height.  On top of the block the unknown is therefore v_z = u_z +
        tilt . u_xy.  Under an even flat u is v itself, not a copy.
        """
        if self.tilt is None:
            return v
        u = v.copy()
        u[0, ..., 2] -= (self.tilt * v[0, ..., :2]).sum(axis=-1)
        return u

    def force_on_unknowns(self, force: FloatArray) -> FloatArray:
        """Turn forces on u into forces on v, in place, and return them.

        This is the transpose of `physical_displacement`: the displacement u differs
        from the unknown v only under a punch.

        Args:
            force: (levels, nx, ny, 3), in N.
        """
        if self.tilt is not None:
            force[0, ..., :2] -= self.tilt * force[0, ..., 2:]
        return force

    def gap(self, v: FloatArray, approach: float) -> FloatArray:
        """Return the (nx, ny) gap between the top and the flat, in m.

        It is negative where the top penetrates the flat.

        Args:
            v: (levels, nx, ny, 3) unknown displacements in m; only the top level is
                used.
            approach: d in m; the flat is at the height -d.
        """
        return np.asarray(-v[0, ..., 2] - self.heights - approach)

    def clear_base(self, force: FloatArray) -> FloatArray:
        """Set the reactions of the base to zero, in place, and return the forces.

        A bonded base holds all components, a sliding one only z.

        Args:
            force: (levels, nx, ny, 3) in N; forces on the upper levels alone stay as
                they are.
        """
        if len(force) > len(self.block.layers):
            first_held = 0
            if self.block.sliding:
                first_held = 2
            force[-1, ..., first_held:] = 0
        return force

    def layer_stresses(
        self, state: State, history: History, layer: int
    ) -> tuple[FloatArray, Elements]:
        """Return the stresses of one layer of elements, and these elements.

        Args:
            state: state of the problem, with the displacements.
            history: plastic strains of all elements at this state.
            layer: number of the layer, 0 at the top.

        Returns:
            (nx ny, 6, 8) stresses xx, yy, zz, xy, yz, zx at the Gauss points in Pa, and
            the layer's elements.
        """
        nodes = self.heights.size
        part = slice(layer * nodes, (layer + 1) * nodes)
        bricks = self.bricks._replace(
            connectivity=self.bricks.connectivity[part],
            shape_of=self.bricks.shape_of[part],
        )
        layer_history = None
        if self.plastic:
            layer_history = history._replace(rows=history.rows[part])
        u = self.physical_displacement(state.displacement).reshape(-1, 3)
        return plasticity.stresses(u, bricks, self.law, layer_history), bricks

    def reaction(self, states: States, internal: FloatArray) -> FloatArray:
        """Return the reaction R: minus the internal force and the capped forces.

        In a solution R is the contact force on the ELASTIC top nodes, and zero
        elsewhere.

        Args:
            states: (nx, ny) contact states of the top nodes.
            internal: (nz + 1, nx, ny, 3) internal force, in N; it is not changed.

        Returns:
            (nz + 1, nx, ny, 3) in N, with zeros where the base holds the nodes.
        """
        R = self.clear_base(-internal)
        R[0, ..., 2] -= self.capped_forces(states)
        return R

    def capped_forces(self, states: States) -> FloatArray:
        """Return (nx, ny) forces in N: the problem's cap at PLASTIC nodes, 0 elsewhere.

        `states` are the (nx, ny) contact states of the top nodes.
        """
        return np.where(states == PLASTIC, self.cap, 0.0)

    def contact_forces(self, states: States, reaction: FloatArray) -> FloatArray:
        """Return the (nx, ny) downward contact forces, in N.

        They are the reaction at ELASTIC nodes, the cap at PLASTIC ones, and 0 at nodes
        that are APART.

        Args:
            states: (nx, ny) contact states of the top nodes.
            reaction: (nx, ny) z component of the reaction on the top, in N.
        """
        return np.where(states == ELASTIC, reaction, self.capped_forces(states))

    def capped_load(self, states: States) -> float:
        """Return the total force that the PLASTIC nodes carry at the cap, in N.

        `states` are the (nx, ny) contact states of the top nodes.
        """
        count = int((states == PLASTIC).sum())
        if count == 0:
            return 0.0  # the cap may be infinite
        return self.cap * count

    def missing_load(self, R: FloatArray, states: States, control: Control) -> float:
        """Return the prescribed load less the contact forces, in N.

        Args:
            R: (levels, nx, ny, 3) reaction, in N.
            states: (nx, ny) contact states of the top nodes.
            control: prescribed load or approach; in approach control nothing is
                missing, and 0 is returned.
        """
        if control.load is None:
            return 0.0
        total = float(R[0, ..., 2][states == ELASTIC].sum()) + self.capped_load(states)
        return control.load - total

    def residuals(
        self, state: State, R: FloatArray, control: Control
    ) -> dict[str, float]:
        """Return the dimensionless residuals of a state.

        The first three are relative to the total force, or to the largest force of the
        path if that is larger; the others are relative to the rms height, or to the
        uniform compression of a flat surface.

            balance      norm of the unbalanced nodal forces
            load         missing load
            tension      largest pull of a contact node
            gap          largest gap of an elastic node
            penetration  of the deepest node that is apart, or largest gap of a plastic
                         node

        Args:
            state: state whose displacement, approach and contact states are checked.
            R: (nz + 1, nx, ny, 3) reaction of the state, in N.
            control: prescribed load or approach, and the largest force so far.
        """
        contact = state.states == ELASTIC
        forces = np.where(contact, R[0, ..., 2], 0.0)
        pressed = float(forces.sum()) + self.capped_load(state.states)
        # If nothing has ever pressed, all forces are exactly zero.
        total = max(control.scale, pressed) or 1.0
        uniform = total / self.heights.size * float(self.factor.surface[0, 0])
        length = float(np.std(self.heights)) or uniform
        gap = self.gap(state.displacement, state.approach)
        penetration = max(
            (-gap[state.states == APART]).max(initial=0.0),
            gap[state.states == PLASTIC].max(initial=0.0),
        )
        return {
            "balance": unbalanced_norm(R, state.states, self.workers) / total,
            "load": abs(self.missing_load(R, state.states, control)) / total,
            "gap": float(np.abs(gap[contact]).max(initial=0.0)) / length,
            "penetration": float(penetration) / length,
            "tension": float((-forces[contact]).max(initial=0.0)) / total,
        }
