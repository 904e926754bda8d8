"""Limit loads of small bodies: the same bricks and return mapping, a direct solver.

The elements may lack mean dilatation, and then lock (`strip_punch`).  The mean pressure
is linear in the strain, and only this part depends on the mean dilatation: it is split
off as a constant matrix.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from epcontact.errors import NotConverged
from epcontact.results import FloatArray
from fem_check import plasticity
from fem_check.element import CORNERS, Elements, elastic_stiffness, elements_of
from fem_check.plasticity import (
    History,
    J2Law,
    TangentCorrection,
    layer_stiffness,
)
from fem_check.smoother import subtract_correction

#: Norm of the free forces over the largest force at which a step has converged.
TOLERANCE = 1e-9
#: Newton iterations after which a step is given up.
MAX_ITERATIONS = 40
#: Prandtl's mean pressure under a smooth strip punch, over the yield stress.
STRIP_LIMIT = (2 + math.pi) / math.sqrt(3)


class PushStep(NamedTuple):
    """One step of `push`.

    Attributes:
        unknowns: displacements, in m.
        forces: on the unknowns, in N.
        residuals: relative residual after each Newton iteration.
    """

    unknowns: FloatArray
    forces: FloatArray
    residuals: tuple[float, ...]


def assemble(bricks: Elements, matrices: FloatArray) -> sp.csr_matrix:
    """Return the sparse sum of element matrices, with one row per nodal component.

    Args:
        bricks: m elements.
        matrices: (m, 24, 24), one for each element, with rows 3 corner + component.

    Returns:
        (3 nodes, 3 nodes) matrix in the unit of `matrices`, with rows 3 node +
        component.
    """
    dofs = (3 * bricks.connectivity[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows = np.repeat(dofs, 24, axis=1).ravel()
    columns = np.tile(dofs, (1, 24)).ravel()
    size = 3 * (int(bricks.connectivity.max()) + 1)
    matrix = sp.coo_matrix((matrices.ravel(), (rows, columns)), shape=(size, size))
    return matrix.tocsr()


def element_tangents(
    bricks: Elements,
    stiffness: tuple[FloatArray, FloatArray],
    correction: TangentCorrection,
    scale: float,
) -> FloatArray:
    """Return the (m, 24, 24) consistent tangents of the elements, in N/m.

    Args:
        bricks: m elements.
        stiffness: elastic stiffness in N/m and deviatoric integrals in m of each shape
            of element, as from `layer_stiffness`.
        correction: consistent tangent less elastic stiffness, in the elements that
            flow.
        scale: factor of the correction: 1 gives the tangent, 0 the elastic stiffness.
    """
    elastic, deviatoric = stiffness
    tangents: FloatArray = elastic.reshape(-1, 576)[bricks.shape_of]
    for element, terms in zip(*correction, strict=True):
        shape = bricks.shape_of[element]
        subtract_correction(
            tangents[element],
            deviatoric[shape],
            bricks.gradients[shape],
            bricks.weights[shape],
            terms,
            scale,
        )
    return tangents.reshape(-1, 24, 24)


def push(
    bricks: Elements,
    law: J2Law,
    free: NDArray[np.bool_],
    pushed: NDArray[np.integer],
    path: Iterable[float],
    mean_dilatation: bool = True,
    motion: Any = None,
) -> list[PushStep]:
    """Push some unknowns of a body step by step, and return one `PushStep` per step.

    Each step is solved by Newton's method, whose tangent is blended with the elastic
    stiffness by a tenth of the relative residual.

    Args:
        bricks: the elements.
        law: of the material.
        free: (n,) True for the unknowns that are solved for.
        pushed: numbers of the unknowns that are prescribed; the others are zero.
        path: value of the pushed unknowns at the end of each step, in m.
        mean_dilatation: whether the elements have mean dilatation; plain ones lock.
        motion: (3 nodes, n) sparse matrix that turns the unknowns into displacements;
            None: the unknowns are the displacements 3 node + component.

    Raises:
        NotConverged: the relative residual of a step is above `TOLERANCE` (1e-9) after
            `MAX_ITERATIONS` (40); the error's history holds the residuals.
    """

    body = _Body(bricks, law, mean_dilatation, motion)
    history = plasticity.initial_history(bricks.number)
    q = np.zeros(body.motion.shape[1])
    steps = []
    for value in path:
        change = np.zeros_like(q)
        change[pushed] = value - q[pushed]
        step, flowing = body.solve_step(q, change, free, history)
        q = step.unknowns
        history = plasticity.commit(
            body.displacements(q), bricks, body.shear_law, history, flowing
        )
        steps.append(step)
    return steps


class _Body:
    """A body whose mean pressure is split off; arguments as in `push`."""

    def __init__(
        self, bricks: Elements, law: J2Law, mean_dilatation: bool, motion: Any
    ) -> None:
        """Store the body of `push`, and assemble its elastic matrices.

        Args:
            bricks: the elements.
            law: of the material.
            mean_dilatation: whether the elements have mean dilatation; plain ones lock.
            motion: (3 nodes, n) sparse matrix that turns the n unknowns into
                displacements; None: the unknowns are the displacements.
        """

        def stiffness(shear_modulus: float) -> FloatArray:
            """Return the (shapes, 24, 24) elastic stiffness of each shape, in N/m.

            The bulk modulus is that of the law, and `shear_modulus` is in Pa.
            """
            matrices = [
                elastic_stiffness(
                    bricks,
                    shape,
                    shear_modulus,
                    law.bulk_modulus,
                    mean_dilatation=mean_dilatation,
                )
                for shape in range(len(bricks.weights))
            ]
            return np.stack(matrices)

        self.bricks = bricks
        self.shear_law = law._replace(bulk_modulus=0.0)
        self.stiffness = stiffness(law.shear_modulus), layer_stiffness(bricks, law)[1]
        self.spheric = assemble(bricks, stiffness(0.0)[bricks.shape_of])
        self.motion = motion
        if motion is None:
            self.motion = sp.identity(self.spheric.shape[0], format="csr")

    def displacements(self, q: FloatArray) -> FloatArray:
        """Return the body's (nodes, 3) displacements in m, from its unknowns q in m."""
        return np.asarray((self.motion @ q).reshape(-1, 3))

    def tangent(
        self, q: FloatArray, history: History, flowing: NDArray[np.bool_], scale: float
    ) -> sp.csc_matrix:
        """Return the (n, n) sparse tangent stiffness of the body's unknowns, in N/m.

        Args:
            q: (n,) unknowns, in m.
            history: of the elements before the step.
            flowing: (m,) True for the elements that flow.
            scale: factor of the plastic correction: 1 gives the consistent tangent, 0
                the elastic stiffness.
        """
        correction = plasticity.tangent_correction(
            self.displacements(q), self.bricks, self.shear_law, history, flowing
        )
        tangents = element_tangents(self.bricks, self.stiffness, correction, scale)
        return (self.motion.T @ assemble(self.bricks, tangents) @ self.motion).tocsc()

    def solve_step(
        self,
        q: FloatArray,
        change: FloatArray,
        free: NDArray[np.bool_],
        history: History,
    ) -> tuple[PushStep, NDArray[np.bool_]]:
        """Solve one step of the body by Newton's method.

        Args:
            q: (n,) unknowns before the step, in m; they are not changed.
            change: (n,) change of the pushed unknowns in m, 0 for the others.
            free: (n,) True for the unknowns that are solved for.
            history: of the elements before the step.

        Returns:
            The step, and (m,) True for the elements that flow.

        Raises:
            NotConverged: the relative residual is above `TOLERANCE` (1e-9) after
                `MAX_ITERATIONS` (40).
        """
        residuals: list[float] = []
        for iteration in range(MAX_ITERATIONS + 1):
            u = self.displacements(q)
            force, flowing = plasticity.internal_force(
                u, self.bricks, self.shear_law, history
            )
            forces = self.motion.T @ (force.ravel() + self.spheric @ u.ravel())
            scale = 0.0
            if iteration:
                residual = float(np.linalg.norm(forces[free]) / np.abs(forces).max())
                residuals.append(residual)
                if residual <= TOLERANCE:
                    return PushStep(q, forces, tuple(residuals)), flowing
                scale = 1 - min(1.0, 0.1 * residual)
            K = self.tangent(q, history, flowing, scale)
            right = -forces
            q = q.copy()  # earlier steps keep their unknowns
            if iteration == 0:
                right -= K @ change
                q += change
            q[free] += splu(K[free][:, free]).solve(right[free])
        raise NotConverged(
            f"the body is not in equilibrium after {MAX_ITERATIONS} Newton iterations: "
            f"relative residual {residuals[-1]:.1e} instead of {TOLERANCE:.0e}",
            history=residuals,
        )


def strip_punch(
    count: int,
    *,
    poisson_ratio: float = 0.3,
    mean_dilatation: bool = True,
    steps: int = 6,
) -> FloatArray:
    """Push a smooth strip punch into a body in plane strain.

    Half of the body is solved.  The half-width of the punch is the unit of length, and
    the half body is 5 wide and 5 deep.

    Args:
        count: elements under the half-width of the punch.
        poisson_ratio: of the body.
        mean_dilatation: of the elements.
        steps: number of steps; the last one is far beyond the limit load.

    Returns:
        (steps,) mean pressure over the yield stress.
    """
    n = 5 * count
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)  # [across, down]
    corners = [node[x : n + x, 1 - z : n + 1 - z].ravel() for x, _, z in CORNERS]
    shape = CORNERS[None] * [1 / count, 1.0, 1 / count]
    bricks = elements_of(np.stack(corners, axis=1), np.zeros(n * n, dtype=int), shape)
    free = np.ones((n + 1, n + 1, 3), dtype=bool)
    free[..., 1] = False  # plane strain
    free[[0, -1], :, 0] = False  # symmetry, and the far side
    free[:, -1, 2] = False  # the base
    free[: count + 1, 0, 2] = False  # the punch
    pushed = 3 * node[: count + 1, 0] + 2
    law = plasticity.j2_law(1000.0, poisson_ratio, 1.0)
    path = -0.072 * np.linspace(1 / steps, 1.0, steps)
    solved = push(
        bricks, law, free.ravel(), pushed, path, mean_dilatation=mean_dilatation
    )
    return -np.array([step.forces[pushed].sum() for step in solved])
