"""Limit loads of small bodies: the same bricks and return mapping, but a direct solver.

Symmetry makes the bodies small: every nodal displacement is a linear function of a few unknowns,
u = T q.  An axisymmetric or plane-strain body is one slice of bricks whose faces stay in their
planes.  Axisymmetric slices subtend a small angle; the error of their flat facets is of second
order in it.

`push` prescribes some of the unknowns step by step and finds the forces this takes, by Newton's
method with the consistent tangent, blended with the elastic stiffness by a tenth of the relative
residual, and a sparse direct solver.  `strip_punch` compares such a body with Prandtl's limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from epcontact.errors import NotConverged
from epcontact.results import FloatArray
from fem_check import plasticity
from fem_check.element import CORNERS, Elements, elements, strain_operator
from fem_check.plasticity import History, Law, TangentCorrection

#: Half of the angle that an axisymmetric slice subtends, rad.
SLICE = 0.01


@dataclass(frozen=True)
class SmallBody:
    """A body whose nodal displacements are T q.

    bricks: the elements.  motion: T (3 nodes, unknowns).  held: indices of unknowns that stay
    zero.  mean_dilatation: whether the elements are B-bar bricks; plain ones lock.
    """

    bricks: Elements
    motion: sp.csr_matrix
    held: NDArray[np.int64]
    mean_dilatation: bool = True


def slice_body(
    across: FloatArray, down: FloatArray, *, axisymmetric: bool, mean_dilatation: bool = True
) -> SmallBody:
    """A slice of bricks, in plane strain of unit width or axisymmetric about z.

    Unknown 2 n is the displacement across of node n = i * len(down) + k, 2 n + 1 the one along z.
    The nodes at x = 0 and on the far side are held across, those of the lowest level along z.

    Args:
        across: coordinates x or r of the nodes, ascending from 0.
        down: coordinates z of the nodes, descending from 0.
        axisymmetric: about z; else plane strain.
        mean_dilatation: whether the elements are B-bar bricks.
    """
    nx, nz = len(across), len(down)
    x, z = (g.ravel() for g in np.meshgrid(across, down, indexing="ij"))
    sides = []
    for side in (0, 1):
        turn = (2 * side - 1) * SLICE if axisymmetric else 0.0
        y = x * np.sin(turn) if axisymmetric else np.full(x.size, float(side))
        sides.append((np.stack([x * np.cos(turn), y, z], axis=1), turn))
    points = np.concatenate([sides[0][0], sides[1][0]])
    i, k = (g.ravel() for g in np.meshgrid(np.arange(nx - 1), np.arange(nz - 1), indexing="ij"))
    cx, cy, cz = CORNERS.T
    nodes = cy * nx * nz + (i[:, None] + cx) * nz + k[:, None] + 1 - cz
    rows, columns, values = [], [], []
    n = np.arange(nx * nz)
    for side, (_, turn) in enumerate(sides):
        base = 3 * (side * nx * nz + n)
        rows += [base, base + 1, base + 2]
        columns += [2 * n, 2 * n, 2 * n + 1]
        values += [np.full(n.size, np.cos(turn)), np.full(n.size, np.sin(turn)), np.ones(n.size)]
    motion = sp.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(6 * n.size, 2 * n.size),
    )
    grid = n.reshape(nx, nz)
    held = np.unique(np.concatenate([2 * grid[0], 2 * grid[-1], 2 * grid[:, -1] + 1]))
    bricks = elements(nodes, np.arange(len(nodes)), points[nodes])
    return SmallBody(bricks, motion, held, mean_dilatation)


@dataclass(frozen=True)
class Pushed:
    """One step of `push`: the unknowns, the work-conjugate force on each, Newton's residuals."""

    unknowns: FloatArray
    forces: FloatArray
    residuals: tuple[float, ...]


def push(
    body: SmallBody,
    law: Law,
    pushed: NDArray[np.integer],
    path: Iterable[float],
    *,
    tolerance: float = 1e-9,
    max_newton: int = 40,
) -> list[Pushed]:
    """Give some unknowns prescribed values, step by step, and find the forces this takes.

    Args:
        body: the body, which has never yielded.
        law: its material.
        pushed: indices of the prescribed unknowns.
        path: their value in each step.
        tolerance: norm of the free forces over the largest force.
        max_newton: largest number of iterations a step.

    Raises:
        NotConverged: a step failed; the error holds its residuals.
    """
    history = plasticity.initial_history(body.bricks.number)
    strain = np.stack(
        [
            strain_operator(body.bricks, s, mean_dilatation=body.mean_dilatation)
            for s in range(len(body.bricks.gradients))
        ]
    )
    elastic = elastic_tangents(body.bricks, law, strain)
    q = np.zeros(body.motion.shape[1])
    free = np.ones(q.size, dtype=bool)
    free[body.held] = free[pushed] = False
    out = []
    for value in path:
        q, history, step = _push_step(
            body, law, history, (strain, elastic), (pushed, value, free), q, (tolerance, max_newton)
        )
        out.append(step)
    return out


def _push_step(
    body: SmallBody,
    law: Law,
    history: History,
    operators: tuple[FloatArray, FloatArray],
    goal: tuple[NDArray[np.integer], float, NDArray[np.bool_]],
    before: FloatArray,
    limits: tuple[float, int],
) -> tuple[FloatArray, History, Pushed]:
    (pushed, value, free), (strain, elastic) = goal, operators
    q, residuals = before.copy(), []
    change = np.zeros_like(q)
    change[pushed] = value - q[pushed]
    for iteration in range(limits[1] + 1):
        u = (body.motion @ q).reshape(-1, 3)
        force, soft, flowing = _force(body, law, history, strain, u)
        forces = body.motion.T @ force.ravel()
        if iteration > 0:
            residuals.append(float(np.linalg.norm(forces[free]) / np.abs(forces).max()))
            if residuals[-1] <= limits[0]:
                past = plasticity.commit(u, body.bricks, law, history, flowing)
                return q, past, Pushed(q, forces, tuple(residuals))
        blend = min(1.0, 0.1 * residuals[-1]) if residuals else 1.0
        per_element = tangents(body.bricks, elastic, strain, soft, blend)
        K = (body.motion.T @ sparse_matrix(body.bricks, per_element, len(u)) @ body.motion).tocsc()
        right = -forces - (K @ change if iteration == 0 else 0.0)
        q = q + (change if iteration == 0 else 0.0)
        q[free] += splu(K[free][:, free]).solve(right[free])
    raise NotConverged(
        f"the body is not in equilibrium after {limits[1]} Newton iterations: relative residual "
        f"{residuals[-1]:.1e} instead of {limits[0]:.0e}",
        history=residuals,
    )


def _force(
    body: SmallBody, law: Law, history: History, strain: FloatArray, u: FloatArray
) -> tuple[FloatArray, TangentCorrection, NDArray[np.bool_]]:
    """(nodes, 3) internal force at `u`, the correction of the elastic tangent, and what flows."""
    bricks = body.bricks
    force, flowing = plasticity.internal_force(u, bricks, law, history)
    if not body.mean_dilatation:  # use the local dilatation instead of the mean one
        B, weights = strain[bricks.shape_of], bricks.weights[bricks.shape_of]
        stress = plasticity.stresses(u, bricks, law, history)
        local = np.einsum("egia,ea->egi", B, u[bricks.connectivity].reshape(-1, 24))[..., :3]
        stress[:, :3] += (law.bulk * local.sum(axis=2) - stress[:, :3].mean(axis=1))[:, None]
        nodal = np.einsum("egia,eig,eg->ea", B, stress, weights, optimize=True)
        force = np.zeros_like(u)
        np.add.at(force, bricks.connectivity, nodal.reshape(-1, 8, 3))
    return force, plasticity.tangent_correction(u, bricks, law, history, flowing), flowing


def elastic_tangents(bricks: Elements, law: Law, strain: FloatArray) -> FloatArray:
    """(shapes, 24, 24) elastic stiffnesses."""
    D = np.diag([2 * law.shear] * 3 + [law.shear] * 3)
    D[:3, :3] += law.bulk - 2 * law.shear / 3
    weighted = bricks.weights[..., None, None] * (D @ strain)
    result: FloatArray = np.matmul(np.swapaxes(strain, 2, 3), weighted).sum(axis=1)
    return result


def tangents(
    bricks: Elements, elastic: FloatArray, strain: FloatArray, soft: TangentCorrection, blend: float
) -> FloatArray:
    """(elements, 24, 24) consistent tangents, with a share `blend` of the elastic stiffness."""
    out: FloatArray = elastic[bricks.shape_of]
    B = strain[bricks.shape_of[soft.which]]
    deviator = np.diag([1.0] * 3 + [0.5] * 3)
    deviator[:3, :3] -= 1 / 3
    n = np.moveaxis(soft.terms[:, :6], 1, 2)
    weights = bricks.weights[bricks.shape_of[soft.which]]
    softer = (weights[:, None] * soft.terms[:, 6:])[..., None, None]
    moduli = softer[:, 0] * deviator + softer[:, 1] * n[..., None] * n[..., None, :]
    out[soft.which] -= (1 - blend) * np.matmul(np.swapaxes(B, 2, 3), moduli @ B).sum(axis=1)
    return out


def sparse_matrix(bricks: Elements, per_element: FloatArray, nodes: int) -> sp.csr_matrix:
    """The sparse sum of (elements, 24, 24) matrices, degrees of freedom 3 node + component."""
    dofs = (3 * bricks.connectivity[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows = np.repeat(dofs, 24, axis=1).ravel()
    columns = np.tile(dofs, (1, 24)).ravel()
    return sp.coo_matrix((per_element.ravel(), (rows, columns)), shape=(3 * nodes,) * 2).tocsr()


@dataclass(frozen=True)
class Curve:
    """A computed quantity and its exact value along a path; `newton`: residuals of each step."""

    computed: FloatArray
    exact: FloatArray
    newton: tuple[tuple[float, ...], ...]


def strip_punch(
    elements: int,
    *,
    poisson_ratio: float = 0.3,
    mean_dilatation: bool = True,
    steps: int = 6,
    domain: float = 5.0,
) -> Curve:
    """Mean pressure under a smooth strip punch in plane strain, over the yield stress.

    Args:
        elements: number of elements under half the width of the punch.
        poisson_ratio: nu.
        mean_dilatation: whether the elements are B-bar bricks; plain ones lock.
        steps: number of steps of the punch's path.
        domain: width and depth of the body, in half-widths of the punch.

    Returns:
        The pressure at each step, and Prandtl's limit (2 + pi) k with k = Y/sqrt(3).

    Example:
        >>> curve = strip_punch(1, steps=2, domain=3.0)
        >>> bool(curve.computed[-1] > curve.exact[-1])  # a coarse mesh overestimates the limit
        True
    """
    grid = np.linspace(0, domain, round(domain * elements) + 1)
    body = slice_body(grid, -grid, axisymmetric=False, mean_dilatation=mean_dilatation)
    exact = (2 + math.pi) / math.sqrt(3)
    return punch(body, grid, elements, poisson_ratio, steps, exact)


def punch(
    body: SmallBody,
    grid: FloatArray,
    elements: int,
    poisson_ratio: float,
    steps: int,
    exact: float,
    area: float = 1.0,
) -> Curve:
    """Push a punch of unit half-width, which covers `elements` of the `grid`, into a body.

    `area` is the punch's.  The yield stress is 1; the last step is far beyond the limit load.
    """
    Y, E = 1.0, 1000.0
    top = np.arange(elements + 1) * grid.size  # the nodes (i, level 0) under the punch
    path = -np.linspace(1 / steps, 1.0, steps) * 72 * Y / E
    done = push(body, plasticity.law(E, poisson_ratio, Y), 2 * top + 1, path)
    force = -np.array([step.forces[2 * top + 1].sum() for step in done])
    return Curve(force / area, np.full(steps, exact), tuple(s.residuals for s in done))
