"""Limit loads of small bodies: the same bricks and return mapping, but a sparse direct
solver.

Its elements may lack mean dilatation, and then lock (`strip_punch`).  The mean pressure
is linear in the strain, and split off as a constant matrix: only this depends on the
mean dilatation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from epcontact.errors import NotConverged
from epcontact.results import FloatArray
from fem_check import plasticity
from fem_check.element import CORNERS, Elements, elastic_stiffness, elements
from fem_check.plasticity import Law, TangentCorrection, layer_stiffness
from fem_check.smoother import subtract_correction

#: Norm of the free forces over the largest force.
TOLERANCE = 1e-9


class Pushed(NamedTuple):
    """One step of `push`: the unknowns, the force on each, and the residual of each
    iteration.
    """

    unknowns: FloatArray
    forces: FloatArray
    residuals: tuple[float, ...]


def assembled(bricks: Elements, per_element: FloatArray) -> sp.csr_matrix:
    """The sparse sum of (elements, 24, 24) matrices, degrees of freedom 3 node +
    component.
    """
    dofs = (3 * bricks.connectivity[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows, columns = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    size = 3 * (int(bricks.connectivity.max()) + 1)
    return sp.coo_matrix(
        (per_element.ravel(), (rows, columns)), shape=(size, size)
    ).tocsr()


def tangents(
    bricks: Elements,
    stiffness: tuple[FloatArray, FloatArray],
    correction: TangentCorrection,
    scale: float,
) -> FloatArray:
    """(elements, 24, 24) stiffness of `layer_stiffness`, less `scale` times the
    correction.
    """
    elastic, deviatoric = stiffness
    out: FloatArray = elastic.reshape(-1, 576)[bricks.shape_of]
    for e, terms in zip(*correction, strict=True):
        s = bricks.shape_of[e]
        gradients, weights = bricks.gradients[s], bricks.weights[s]
        subtract_correction(out[e], deviatoric[s], gradients, weights, terms, scale)
    return out.reshape(-1, 24, 24)


def push(
    bricks: Elements,
    law: Law,
    free: NDArray[np.bool_],
    pushed: NDArray[np.integer],
    path: Iterable[float],
    mean_dilatation: bool = True,
    motion: Any = None,
) -> list[Pushed]:
    """Push some unknowns of a body step by step, and find the forces.  Raises
    NotConverged. Newton's method is blended with the elastic stiffness by a tenth of
    the relative residual.  The displacements are `motion` (sparse) times the unknowns,
    or are the unknowns; those neither `free` nor `pushed` stay zero.
    """

    def stiffness(shear: float) -> FloatArray:
        each = partial(elastic_stiffness, bricks, mean_dilatation=mean_dilatation)
        return np.stack([each(s, shear, law.bulk) for s in range(len(bricks.weights))])

    spheric = assembled(bricks, stiffness(0.0)[bricks.shape_of])
    both = stiffness(law.shear), layer_stiffness(bricks, law)[1]
    T = sp.identity(spheric.shape[0], format="csr") if motion is None else motion
    shearing, history = (
        law._replace(bulk=0.0),
        plasticity.initial_history(bricks.number),
    )
    q, out = np.zeros(T.shape[1]), []
    for value in path:
        change, residuals = np.zeros_like(q), list[float]()
        change[pushed] = value - q[pushed]
        for iteration in range(41):
            u = (T @ q).reshape(-1, 3)
            force, flowing = plasticity.internal_force(u, bricks, shearing, history)
            forces = T.T @ (force.ravel() + spheric @ u.ravel())
            if iteration:
                residuals.append(
                    float(np.linalg.norm(forces[free]) / np.abs(forces).max())
                )
                if residuals[-1] <= TOLERANCE:
                    break
            soft = plasticity.tangent_correction(u, bricks, shearing, history, flowing)
            scale = 1 - min(1.0, 0.1 * residuals[-1]) if residuals else 0.0
            K = (
                T.T @ assembled(bricks, tangents(bricks, both, soft, scale)) @ T
            ).tocsc()
            right = -forces - (K @ change if not iteration else 0.0)
            q = q + (change if not iteration else 0.0)
            q[free] += splu(K[free][:, free]).solve(right[free])
        else:
            raise NotConverged(
                f"the body is not in equilibrium after 40 Newton iterations: relative residual "
                f"{residuals[-1]:.1e} instead of {TOLERANCE:.0e}",
                history=residuals,
            )
        history = plasticity.commit(u, bricks, shearing, history, flowing)
        out.append(Pushed(q, forces, tuple(residuals)))
    return out


#: Prandtl's mean pressure under a smooth strip punch over the yield stress: (2 +
#: pi)/sqrt(3).
STRIP_LIMIT = (2 + math.pi) / math.sqrt(3)


def strip_punch(
    count: int,
    *,
    poisson_ratio: float = 0.3,
    mean_dilatation: bool = True,
    steps: int = 6,
) -> FloatArray:
    """(steps,) mean pressure over the yield stress under a smooth strip punch in plane
    strain. `count` elements are under half of its width, the unit of length; half of
    the body is 5 wide and deep.  The last step is far beyond the limit load.
    """
    n = 5 * count
    number = np.arange((n + 1) ** 2).reshape(
        n + 1, n + 1
    )  # of the nodes, [across, down]
    corners = [number[x : n + x, 1 - z : n + 1 - z].ravel() for x, _, z in CORNERS]
    shape = CORNERS[None] * [1 / count, 1.0, 1 / count]
    bricks = elements(np.stack(corners, axis=1), np.zeros(n * n, dtype=int), shape)
    free = np.ones((n + 1, n + 1, 3), dtype=bool)
    free[..., 1] = free[[0, -1], :, 0] = free[:, -1, 2] = free[: count + 1, 0, 2] = (
        False
    )
    under = 3 * number[: count + 1, 0] + 2
    law = plasticity.law(1000.0, poisson_ratio, 1.0)
    path = -0.072 * np.linspace(1 / steps, 1.0, steps)
    done = push(bricks, law, free.ravel(), under, path, mean_dilatation=mean_dilatation)
    return -np.array([step.forces[under].sum() for step in done])
