"""Unilateral contact of the top with a rigid frictionless flat, exact at every node.

With F the downward nodal forces, v the downward displacement of the top, h the heights and the
flat at the height -d, the gap is g = v - h - d, and a solution satisfies, node by node,

    F = 0 and g >= 0,    or    0 <= F <= F_cap and g = 0,    or    F = F_cap and g <= 0,

with sum F = P in load control, or d given.  `solve_contact_forces` meets the equalities on a given
contact set by conjugate gradients on the surface, where the elastic compliance is a pair of
transforms; `rigid_contact` finds the sets by a semi-smooth Newton method.
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

#: A gap times this share of the stiffness of the shortest wave predicts a force.  With larger
#: shares nodes jump between apart and capped, and the sets can cycle.
PREDICTION = 0.3


@compiled
def _project(values, contact, free):  # type: ignore[no-untyped-def]
    """The values on the contact, less their mean there if `free`, and zeros elsewhere."""
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
    """(forces in N, d in m) on the `contact` nodes that displace them by `wanted` + d.  Conjugate
    gradients preconditioned by 1/compliance (m/N, a value a wave) reduce the residual by
    `tolerance`.  The forces sum up to the `load`, which makes d an unknown, and gives all residuals
    and directions zero mean over the contact nodes; if it is None, d = 0."""
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
    # If `wanted` is uniform, load control, which leaves the mean free, leaves only rounding.
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


def predicted_states(forces: FloatArray, gap: FloatArray, cap: float, stiffness: float) -> States:
    """The state of each node that its force and its gap ask for (see `PREDICTION`)."""
    predicted = forces - PREDICTION * stiffness * gap
    states = np.full(forces.shape, ELASTIC, dtype=np.int8)
    states[predicted <= 0] = APART
    states[predicted >= cap] = PLASTIC
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
    """Solve the contact of a rigid flat with an elastic body, given the compliance of its top.  The
    total force is `load` or, if that is None, the `approach` d is given.  Raises NotConverged."""
    nx, stiffness = heights.shape[0], 1.0 / float(compliance.min())
    states = _first_states(heights, load, approach, cap)
    forces, residuals = np.zeros(heights.shape), []
    for sweep in range(200):
        if load is not None:
            states = _with_load(states, heights, load, cap)
        contact, fixed = states == ELASTIC, np.where(states == PLASTIC, cap, 0.0)
        already = inverse(compliance * transform(fixed), nx)
        forces, d = solve_contact_forces(
            compliance,
            heights - already + (0.0 if load is not None else approach),
            contact,
            None if load is None else load - float(fixed.sum()),
            forces,
            tolerance=1e-3 if sweep < 3 else 1e-12,
        )
        forces, d = forces + fixed, d if load is not None else approach
        gap = inverse(compliance * transform(forces), nx) - heights - d
        gap[contact] = 0.0
        new = predicted_states(forces, gap, cap, stiffness)
        changed = int((new != states).sum())
        residuals.append(changed / states.size)
        if changed == 0 and sweep >= 3:
            return SurfaceContact(forces, states, d)
        if sweep >= 30:  # only a random third of the nodes change, to break cycles
            keep = np.random.default_rng(sweep).random(states.shape) < 2 / 3
            new = np.where(keep, states, new).astype(np.int8)
        states = new
    sentence = f"the elastic contact did not settle: {changed} nodes still change their state"
    raise NotConverged(sentence, history=residuals)


def _first_states(heights: FloatArray, load: float | None, approach: float, cap: float) -> States:
    """A first guess: in load control the highest quarter of the nodes, or more if capped."""
    if load is None:
        return np.where(heights + approach > 0, ELASTIC, APART).astype(np.int8)
    needed = 0.0 if np.isinf(cap) else load / cap / heights.size
    level = np.quantile(heights, 1 - min(1.0, max(0.25, 1.5 * needed)))
    return np.where(heights >= level, ELASTIC, APART).astype(np.int8)


def _with_load(states: States, heights: FloatArray, load: float, cap: float) -> States:
    """The states, some of them elastic instead, so that the contact can carry the load."""
    capped, contact, out = states == PLASTIC, states == ELASTIC, states.copy()
    if np.isinf(cap):
        if not contact.any():
            out.ravel()[int(np.argmax(heights))] = ELASTIC
        return out
    if capped.sum() * cap < load < (capped.sum() + contact.sum()) * cap:
        return out
    order = np.argsort(heights.ravel())[::-1]
    rank = np.where(capped.ravel()[order], 0, np.where(contact.ravel()[order], 1, 2))
    order = order[np.argsort(rank, kind="stable")]
    full = int(load / cap)  # the most nodes that can be capped
    flat = out.ravel()
    kept = order[: max(0, full - max(1, full // 4))]
    flat[order[len(kept) : full + max(2, full // 4)]] = ELASTIC
    flat[kept] = np.where(flat[kept] == APART, ELASTIC, flat[kept])
    return out
