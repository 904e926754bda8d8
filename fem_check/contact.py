"""Unilateral contact of the top with a rigid frictionless flat.

With F the downward nodal forces, v the downward displacement of the top, h the heights
and the flat at the height -d, the gap is g = v - h - d.  At each node a solution is

    apart     F = 0               and  g >= 0, or
    elastic   0 <= F <= F_cap     and  g = 0, or
    plastic   F = F_cap           and  g <= 0,

with sum F = P in load control, or a given d.  `solve_contact_forces` solves the
equalities for a given contact set by conjugate gradients on the surface, where the
elastic compliance is a pair of Fourier transforms.  `rigid_contact` finds the sets by a
semi-smooth Newton method.
"""

# mypy: allow-untyped-defs
# numba infers the types of the compiled functions.

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray
from fem_check.lanes import compiled
from fem_check.linear_solver import inverse_transform, transform
from fem_check.workers import axpy, dot, norm, xpay

#: Contact states of the nodes: APART, ELASTIC or PLASTIC.
States = NDArray[np.int8]

#: A gap times this fraction of the stiffness of the shortest wave predicts a force.
#: With larger fractions nodes jump between apart and capped, and the sets can cycle.
PREDICTION = 0.3
#: Full Newton steps of a rigid contact; most contacts need five.
FULL_STEPS = 12
#: Newton steps of a rigid contact after which it is given up.
MAX_STEPS = 200


@compiled
def _project(values, contact, zero_mean):
    """Return the values on the contact nodes, and zeros elsewhere, as a new array.

    Args:
        values: (nx, ny) in any unit.
        contact: (nx, ny) True for the contact nodes; at least one if `zero_mean`.
        zero_mean: whether the mean over the contact nodes is subtracted there.
    """
    nx, ny = values.shape
    mean = 0.0
    if zero_mean:
        count = 0
        for i in range(nx):
            for j in range(ny):
                if contact[i, j]:
                    mean += values[i, j]
                    count += 1
        mean /= count
    projected = np.zeros((nx, ny))
    for i in range(nx):
        for j in range(ny):
            if contact[i, j]:
                projected[i, j] = values[i, j] - mean
    return projected


def solve_contact_forces(
    compliance: FloatArray,
    wanted: FloatArray,
    contact: NDArray[np.bool_],
    load: float | None,
    start: FloatArray | None = None,
    tolerance: float = 1e-11,
) -> tuple[FloatArray, float]:
    """Solve for the forces that give the contact nodes a prescribed displacement.

    Conjugate gradients are preconditioned by 1/compliance.  A prescribed load makes the
    approach an unknown; residuals and directions then have zero mean over the contact
    nodes.  After 499 iterations the result is returned as it is, without an error.

    Args:
        compliance: (nx // 2 + 1, ny) displacement per force of each wave, in m/N.
        wanted: (nx, ny) downward displacement of the contact nodes, in m, to which the
            approach is added.
        contact: (nx, ny) True for the contact nodes.
        load: sum of the forces, in N; None: the approach is 0.
        start: (nx, ny) first guess of the forces, in N; None: no forces.
        tolerance: factor by which the residual is reduced.

    Returns:
        forces: (nx, ny) in N, zero outside of the contact.
        approach: in m; 0 if no node is in contact.
    """
    count = int(contact.sum())
    nx = contact.shape[0]
    if count == 0:
        return np.zeros(contact.shape), 0.0

    def project(values: FloatArray) -> FloatArray:
        """Return (nx, ny) `values` on the contact nodes, and zeros elsewhere.

        In load control, their mean over the contact nodes is subtracted.
        """
        return np.asarray(_project(values, contact, load is not None))

    def displacement(forces: FloatArray) -> FloatArray:
        """Return the (nx, ny) downward displacement in m under (nx, ny) forces in N."""
        return inverse_transform(compliance * transform(forces), nx)

    forces = np.zeros(contact.shape)
    if start is not None:
        forces = np.where(contact, start, 0.0)
    if load is not None:
        forces = np.where(contact, forces + (load - forces.sum()) / count, 0.0)
    initial = displacement(forces)
    full_residual = wanted - initial
    residual = project(full_residual)
    # A uniform `wanted` leaves only rounding errors as the residual in load control.
    rounding = 8 * np.finfo(float).eps * (norm(wanted) + norm(initial))
    goal = max(tolerance * (norm(project(wanted)) + norm(residual)), rounding)
    direction = np.zeros_like(residual)
    rho_before = np.inf
    for _ in range(499):
        if norm(residual) <= goal:
            break
        z = project(inverse_transform(transform(residual) / compliance, nx))
        rho = dot(residual, z)
        xpay(direction, rho / rho_before, z)
        product = displacement(direction)
        step = rho / dot(direction, product)
        axpy(forces, step, direction)
        axpy(full_residual, -step, product)
        residual = project(full_residual)
        rho_before = rho
    if load is None:
        return forces, 0.0
    return forces, -float(full_residual[contact].mean())


def shift_to_load(forces: FloatArray, cap: float, load: float | None) -> FloatArray:
    """Return the forces plus the constant at which they carry a load.

    Args:
        forces: (nx, ny) in N; a node carries its force clipped to the range from 0 to
            the cap.
        cap: largest nodal force in N; may be infinite.
        load: sum of the clipped forces in N; None: the forces are returned as they are.

    Returns:
        (nx, ny) forces in N, not clipped.  If all nodes at the cap carry less than the
        load, the forces are shifted beyond the cap and carry too little.
    """
    if load is None:
        return forces
    # The carried load is piecewise linear in the shift.  A node begins to carry at the
    # shift -force, and reaches the cap at the shift cap - force.
    starts = -forces.ravel()
    knots = starts
    if np.isfinite(cap):
        knots = np.concatenate([starts, starts + cap])
    order = np.argsort(knots, kind="stable")
    knots = knots[order]
    slopes = np.cumsum(np.where(order < starts.size, 1, -1))
    carried = np.concatenate([[0.0], np.cumsum(slopes[:-1] * np.diff(knots))])
    beyond = max(0.0, load - float(carried[-1])) / max(int(slopes[-1]), 1)
    return np.asarray(forces + (np.interp(load, carried, knots) + beyond))


def predict_states(
    forces: FloatArray,
    gap: FloatArray,
    cap: float,
    stiffness: float,
    load: float | None = None,
) -> States:
    """Predict the contact states of the next iteration from forces and gaps.

    A node's predicted force is its force less `PREDICTION` (0.3) times the stiffness
    times its gap.  The node is apart where this force is not positive, plastic where it
    reaches the cap, and elastic otherwise.

    Args:
        forces: (nx, ny) present downward forces, in N.
        gap: (nx, ny) present gaps between the top and the flat, in m.
        cap: largest nodal force, in N; may be infinite.
        stiffness: force per displacement of the shortest wave, in N/m.
        load: sum in N to which a constant shifts the predicted forces; None: they are
            not shifted.  At least one node is then elastic.

    Returns:
        (nx, ny) states APART, ELASTIC or PLASTIC.
    """
    predicted = shift_to_load(forces - PREDICTION * stiffness * gap, cap, load)
    states = np.full(forces.shape, ELASTIC, dtype=np.int8)
    states[predicted <= 0] = APART
    states[predicted >= cap] = PLASTIC
    if load is not None and not (states == ELASTIC).any():
        # Nodes at the cap carry exactly the load.  One elastic node must remain, whose
        # gap determines the approach: the one that came into contact last.
        touching = np.where(predicted > 0, predicted, np.inf)
        states.ravel()[int(np.argmin(touching))] = ELASTIC
    return states


@dataclass(frozen=True)
class SurfaceContact:
    """A solved contact of an elastic body.

    Attributes:
        forces: (nx, ny) nodal forces, in N.
        states: (nx, ny) contact states.
        approach: d, in m.
    """

    forces: FloatArray
    states: States
    approach: float


@dataclass(frozen=True)
class _ElasticBody:
    """An elastic body under a rigid flat; arguments of `rigid_contact`.

    Attributes:
        compliance: (nx // 2 + 1, ny) displacement of the top per force of each wave, in
            m/N.
        heights: (nx, ny) in m; without a load, they contain the prescribed approach.
        load: sum of the forces, in N; None: the approach is prescribed.
        cap: largest nodal force, in N; may be infinite.
    """

    compliance: FloatArray
    heights: FloatArray
    load: float | None
    cap: float

    @property
    def stiffness(self) -> float:
        """Force per displacement of the body's shortest wave, in N/m.

        It is 1 over the smallest compliance.
        """
        return 1.0 / float(self.compliance.min())

    def displacement(self, forces: FloatArray) -> FloatArray:
        """Return the (nx, ny) downward displacement of the body's top, in m.

        `forces` are the (nx, ny) downward nodal forces, in N.
        """
        spectrum = self.compliance * transform(forces)
        return inverse_transform(spectrum, len(self.heights))

    def gap(self, forces: FloatArray) -> FloatArray:
        """Return the (nx, ny) gap of the body in m, less the approach of the flat.

        It is the downward displacement less the heights.  In approach control the
        heights contain the approach; in load control the approach is an unknown
        constant.

        Args:
            forces: (nx, ny) downward nodal forces, in N.
        """
        return self.displacement(forces) - self.heights

    def allowed(self, forces: FloatArray) -> FloatArray:
        """Return (nx, ny) forces in N within the bounds, which carry the body's load.

        A constant is added to `forces` (nx, ny) in N, and the sum is clipped to the
        range from 0 to the cap.  Without a load, the forces are only clipped.
        """
        return np.clip(shift_to_load(forces, self.cap, self.load), 0, self.cap)

    def solve_on_sets(
        self, states: States, start: FloatArray, tolerance: float
    ) -> tuple[FloatArray, float]:
        """Return the body's contact forces and the approach for given contact states.

        Plastic nodes carry the cap, elastic nodes touch the flat, the others carry
        nothing.

        Args:
            states: (nx, ny) APART, ELASTIC or PLASTIC.
            start: (nx, ny) first guess of the forces, in N.
            tolerance: factor by which conjugate gradients reduce the residual.

        Returns:
            forces: (nx, ny) in N; those of elastic nodes may be negative.
            approach: of the flat, in m; 0 if no load is prescribed.
        """
        capped = np.where(states == PLASTIC, self.cap, 0.0)
        elastic_load = None
        if self.load is not None:
            elastic_load = self.load - float(capped.sum())
        forces, approach = solve_contact_forces(
            self.compliance,
            self.heights - self.displacement(capped),
            states == ELASTIC,
            elastic_load,
            start,
            tolerance,
        )
        forces += capped
        return forces, approach

    def lower_energy(self, forces: FloatArray, solved: FloatArray) -> FloatArray:
        """Return forces after a step that lowers the body's energy, inside the bounds.

        The step is from `forces` towards `solved`, or along the energy's gradient if
        the energy rises on the way to `solved`.

        Args:
            forces: (nx, ny) present forces, in N; they are first moved into the bounds.
            solved: (nx, ny) forces of `solve_on_sets`, in N.

        Returns:
            (nx, ny) new forces, in N.
        """
        forces = self.allowed(forces)
        gap = self.gap(forces)
        step = self.allowed(solved) - forces
        if dot(gap, step) >= 0:
            step = self.allowed(forces - PREDICTION * self.stiffness * gap) - forces
        curvature = dot(step, self.displacement(step))
        fraction = min(1.0, -dot(gap, step) / max(curvature, 1e-300))
        return forces + fraction * step


def rigid_contact(
    compliance: FloatArray,
    heights: FloatArray,
    load: float | None = None,
    approach: float = 0.0,
    cap: float = np.inf,
) -> SurfaceContact:
    """Solve the contact of a rigid flat with an elastic body.

    Args:
        compliance: (nx // 2 + 1, ny) displacement of the top per force of each wave, in
            m/N.
        heights: (nx, ny) heights of the top, in m, positive toward the flat.
        load: sum of the forces, in N; None: the approach is prescribed.
        approach: d in m, if no load is prescribed; the flat is at the height -d.
        cap: largest nodal force, in N; may be infinite.

    Returns:
        The nodal forces in N, the contact states, and the approach in m.

    Raises:
        NotConverged: the contact sets still change after `MAX_STEPS` (200) Newton
            steps; the error's history holds the fraction of nodes that changed in each
            step.
    """
    if load is None:
        heights = heights + approach
    body = _ElasticBody(compliance, heights, load, cap)
    forces = body.allowed(PREDICTION * body.stiffness * heights)
    states = np.full(heights.shape, -1, dtype=np.int8)
    changes = []
    exact = False
    for sweep in range(MAX_STEPS):
        gap = body.gap(forces)
        new_states = predict_states(forces, gap, cap, body.stiffness, load)
        changes.append(float((new_states != states).mean()))
        states = new_states
        if exact and changes[-1] == 0:
            return SurfaceContact(forces, states, approach)
        tolerance = 1e-12
        if sweep < 3:
            tolerance = 1e-3
        solved, shift = body.solve_on_sets(states, forces, tolerance)
        if load is not None:
            approach = shift
        if sweep < FULL_STEPS:
            forces = solved
            exact = sweep >= 3
        else:
            # Full steps can cycle; steps that lower the energy cannot.
            forces = body.lower_energy(forces, solved)
            difference = np.abs(forces - solved).max()
            exact = bool(difference <= 1e-12 * np.abs(solved).max())
            if exact:
                forces = solved
    raise NotConverged(
        f"the contact of the elastic body did not converge: after {MAX_STEPS} Newton "
        "steps, nodes still change between contact and gap",
        history=changes,
    )
