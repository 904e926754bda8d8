"""Unilateral contact of the top with a rigid frictionless flat, exact at every node.

With F the downward nodal forces, v the downward displacement of the top, h the heights
and the flat at the height -d, the gap is g = v - h - d, and a solution satisfies, node
by node,

    F = 0 and g >= 0,    or    0 <= F <= F_cap and g = 0,    or    F = F_cap and g <= 0,

with sum F = P in load control, or d given.  `solve_contact_forces` meets the equalities
on a given contact set by conjugate gradients on the surface, where the elastic
compliance is a pair of transforms; `rigid_contact` finds the sets by a semi-smooth
Newton method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray
from fem_check.lanes import compiled
from fem_check.linear_solver import inverse, transform
from fem_check.workers import axpy, dot, norm, xpay

States = NDArray[np.int8]

#: A gap times this share of the stiffness of the shortest wave predicts a force.  With
#: larger shares nodes jump between apart and capped, and the sets can cycle.
PREDICTION = 0.3
#: Full Newton steps of a rigid contact, most of which settle in five.
FULL_STEPS = 12


@compiled
def _project(values, contact, free):  # type: ignore[no-untyped-def]
    """The values on the contact, less their mean there if `free`, and zeros
    elsewhere.
    """
    nx, ny = values.shape
    total, count = 0.0, 0
    for i in range(nx):
        for j in range(ny):
            if contact[i, j]:
                total += values[i, j]
                count += 1
    mean, out = total / count if free else 0.0, np.zeros((nx, ny))
    for i in range(nx):
        for j in range(ny):
            if contact[i, j]:
                out[i, j] = values[i, j] - mean
    return out


def solve_contact_forces(
    compliance: FloatArray,
    wanted: FloatArray,
    contact: NDArray[np.bool_],
    load: float | None,
    start: FloatArray | None = None,
    tolerance: float = 1e-11,
) -> tuple[FloatArray, float]:
    """(forces in N, d in m) on the `contact` nodes that displace them by `wanted` + d.
    Conjugate gradients preconditioned by 1/compliance (m/N, a value a wave) reduce the
    residual by `tolerance`.  The forces sum up to the `load`, which makes d an unknown,
    and gives all residuals and directions zero mean over the contact nodes; if it is
    None, d = 0.
    """
    count, nx, free = int(contact.sum()), contact.shape[0], load is not None
    if count == 0:
        return np.zeros(contact.shape), 0.0

    def project(values: FloatArray) -> FloatArray:
        return np.asarray(_project(values, contact, free))

    def displacement(forces: FloatArray) -> FloatArray:
        return inverse(compliance * transform(forces), nx)

    forces = np.where(contact, 0.0 if start is None else start, 0.0)
    if load is not None:
        forces = np.where(contact, forces + (load - forces.sum()) / count, 0.0)
    answered = displacement(forces)
    residual = project(raw := wanted - answered)
    # If `wanted` is uniform, load control, which leaves the mean free, leaves only
    # rounding.
    rounding = 8 * np.finfo(float).eps * (norm(wanted) + norm(answered))
    enough = max(tolerance * (norm(project(wanted)) + norm(residual)), rounding)
    direction, rho_before = np.zeros_like(residual), np.inf
    for _ in range(499):
        if norm(residual) <= enough:
            break
        z = project(inverse(transform(residual) / compliance, nx))
        rho = dot(residual, z)
        xpay(direction, rho / rho_before, z)
        pushed = displacement(direction)
        step = rho / dot(direction, pushed)
        axpy(forces, step, direction)
        axpy(raw, -step, pushed)
        residual, rho_before = project(raw), rho
    return forces, -float(raw[contact].mean()) if free else 0.0


def carrying(forces: FloatArray, cap: float, load: float | None) -> FloatArray:
    """The forces, all shifted alike until those between 0 and the cap carry the load
    exactly.
    """
    if load is None:
        return forces
    # What is carried is piecewise linear in the shift: a node begins to carry at the
    # shift -force and carries no more than the cap from the shift cap - force on.
    begins = -forces.ravel()
    knots = np.concatenate([begins, begins + cap]) if np.isfinite(cap) else begins
    order = np.argsort(knots, kind="stable")
    slopes, knots = np.cumsum(np.where(order < begins.size, 1, -1)), knots[order]
    carried = np.concatenate([[0.0], np.cumsum(slopes[:-1] * np.diff(knots))])
    beyond = max(0.0, load - float(carried[-1])) / max(int(slopes[-1]), 1)
    return np.asarray(forces + (np.interp(load, carried, knots) + beyond))


def predicted_states(
    forces: FloatArray,
    gap: FloatArray,
    cap: float,
    stiffness: float,
    load: float | None = None,
) -> States:
    """The states by `PREDICTION` that forces and gaps ask for, of which some carry a
    `load`.
    """
    predicted = carrying(forces - PREDICTION * stiffness * gap, cap, load)
    states = np.full(forces.shape, ELASTIC, dtype=np.int8)
    states[predicted <= 0] = APART
    states[predicted >= cap] = PLASTIC
    if load is not None and not (states == ELASTIC).any():
        # Whole nodes at the cap carry it; the approach is that of the last of them.
        touching = np.where(predicted > 0, predicted, np.inf)
        states.ravel()[int(np.argmin(touching))] = ELASTIC
    return states


@dataclass(frozen=True)
class SurfaceContact:
    """A solved surface problem: nodal forces in N, contact states, approach in m."""

    forces: FloatArray
    states: States
    approach: float


def rigid_contact(
    compliance: FloatArray,
    heights: FloatArray,
    load: float | None = None,
    approach: float = 0.0,
    cap: float = np.inf,
) -> SurfaceContact:
    """Solve the contact of a rigid flat with an elastic body, given the compliance of
    its top.  The total force is `load` or, if that is None, the `approach` d is given.
    Raises NotConverged.
    """
    nx, stiffness = heights.shape[0], 1.0 / float(compliance.min())
    rise = heights if load is not None else heights + approach
    states = np.full(heights.shape, -1, dtype=np.int8)

    def displaced(forces: FloatArray) -> FloatArray:
        return inverse(compliance * transform(forces), nx)

    def allowed(forces: FloatArray) -> FloatArray:
        return np.clip(carrying(forces, cap, load), 0, cap)

    forces, changes, whole, d = (
        allowed(PREDICTION * stiffness * rise),
        list[float](),
        False,
        0.0,
    )
    for sweep in range(200):
        gap = displaced(forces) - rise
        new = predicted_states(forces, gap, cap, stiffness, load)
        changes.append(float((new != states).mean()))
        if whole and changes[-1] == 0:
            return SurfaceContact(forces, states, d if load is not None else approach)
        states = new
        contact, fixed = states == ELASTIC, np.where(states == PLASTIC, cap, 0.0)
        wanted, left = (
            rise - displaced(fixed),
            None if load is None else load - float(fixed.sum()),
        )
        accurate = 1e-3 if sweep < 3 else 1e-12
        solved, d = solve_contact_forces(
            compliance, wanted, contact, left, forces, accurate
        )
        solved += fixed
        whole = sweep >= 3
        if sweep < FULL_STEPS:
            forces = solved
            continue
        # Full steps can cycle.  Steps that lower the energy inside the bounds cannot:
        # towards the solution on these sets or, where the energy rises that way, along
        # its gradient.
        forces = allowed(forces)
        gap = displaced(forces) - rise
        downhill = allowed(forces - PREDICTION * stiffness * gap)
        step = allowed(solved) - forces
        if dot(gap, step) >= 0:
            step = downhill - forces
        share = min(1.0, -dot(gap, step) / max(dot(step, displaced(step)), 1e-300))
        forces = forces + share * step
        whole = bool(np.abs(forces - solved).max() <= 1e-12 * np.abs(solved).max())
        forces = solved if whole else forces
    raise NotConverged("the elastic contact did not settle", history=changes)
