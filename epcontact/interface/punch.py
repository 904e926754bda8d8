"""The flat punch on the points of a contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.reference.layers import compliance
from epcontact.results import FloatArray
from epcontact.scene import Scene

Mask = NDArray[np.bool_]

_REDUCTION = 1e-12  # of the residual of the linear solve


def solve_punch(scene: Scene, mask: Mask) -> tuple[float, FloatArray]:
    """Return the sinking (m/Pa) of a flat punch on the points of a mask by a mean
    pressure of 1, and its pressures.
    """
    from scipy.sparse.linalg import (
        LinearOperator,
        cg,
    )  # slow to load, and few cases measure it

    n = int(mask.sum())
    C = compliance(scene)
    C.flat[0] = 0.0
    inverse = np.divide(1.0, C, out=np.zeros_like(C), where=C > 0)

    def displaced(modes: FloatArray, forces: FloatArray) -> FloatArray:
        """Apply the symbol `modes` to forces on F, and return what it gives on F."""
        field = np.zeros(mask.shape)
        field[mask] = forces
        answer = np.fft.irfftn(
            modes * np.fft.rfftn(field), mask.shape, axes=range(mask.ndim)
        )
        return np.asarray(answer[mask])

    def of_zero_mean(modes: FloatArray) -> LinearOperator:
        def times(x: FloatArray) -> FloatArray:
            y = displaced(modes, x - x.mean())
            return np.asarray(y - y.mean())

        return LinearOperator((n, n), matvec=times, dtype=np.float64)

    uniform = np.full(n, mask.size / n)  # a unit of mean pressure
    sunk = displaced(C, uniform)
    right = sunk.mean() - sunk
    S, M = of_zero_mean(C), of_zero_mean(inverse)
    # Where a uniform pressure is the answer, what is right of it is noise.
    noise = _REDUCTION * float(np.linalg.norm(sunk))
    x, failed = cg(S, right, rtol=_REDUCTION, atol=noise, maxiter=2000, M=M)
    if failed:
        raise NotConverged(
            "the stiffness of the interface did not converge in 2000 iterations"
        )
    pressure = np.zeros(mask.shape)
    pressure[mask] = uniform + (x - x.mean())
    return float(displaced(C, pressure[mask]).mean()), pressure
