"""The exact inverse of the elastic flat block: lateral Fourier transforms and sweeps
over levels.

A lateral transform splits the stiffness of flat layers of equal bricks, wave by wave,
into a block-tridiagonal matrix of 3 x 3 blocks A_k (level k with itself) and C_k (with
level k + 1), which are real once u_z is replaced by i u_z.  Elimination from the base
to the top,

    S_k = (A_k - C_k S_{k+1} C_k^T)^-1,   f_k <- f_k - C_k S_{k+1} f_{k+1},

leaves S_0 on the top level, whose normal entry is the surface's compliance; the sweep
back is u_{k+1} = S_{k+1} (f_{k+1} - C_k^T u_k).  Contact forces, which act on the top,
are found between the two sweeps, on the surface alone (`contact`).

Convergence is judged by the internal force of the elements.  Half of the spectrum is
kept along x, so that the spectrum of a line (ny = 1) is halved, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import ducc0
import numpy as np
from numba import njit
from numpy.typing import NDArray

from epcontact.results import FloatArray
from fem_check.element import CORNERS, Elements, elastic_stiffness
from fem_check.lanes import OPTIONS, compiled
from fem_check.mesh import PeriodicBlock
from fem_check.plasticity import Law
from fem_check.workers import ALONE, Workers, pieces

#: About as many nodes are transformed at once: calls then cost little, and threads
#: share levels.
_NODES_AT_ONCE = 8192
#: Waves in a piece that one thread takes.
_WAVES = 256

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Factor:
    """The factorised flat elastic block; q runs over (nx // 2 + 1) * ny waves.

    compliances: (nz + 1, q, 6) the S_k, as 00, 11, 22, 01, 12, 20.  couplings: (nz, q, 9) the C_k.
    """

    shape: tuple[int, int]
    compliances: FloatArray
    couplings: FloatArray
    workers: Workers = ALONE

    @property
    def surface(self) -> FloatArray:
        """(nx // 2 + 1, ny) normal displacement of the top per normal nodal force,
        m/N.
        """
        nx, ny = self.shape
        return self.compliances[0, :, 2].reshape(nx // 2 + 1, ny)


def factorise(
    block: PeriodicBlock, flat: Elements, law: Law, workers: Workers = ALONE
) -> Factor:
    """Eliminate the `flat` elements of `block` wave by wave, with the moduli of
    `law`.
    """
    nx, ny = block.shape
    count, waves = len(block.layers), (nx // 2 + 1) * ny
    cosines, sines = _phases(nx, ny)
    S, C = np.zeros((count + 1, waves, 6)), np.empty((count, waves, 9))
    stencils = [
        _stencils(elastic_stiffness(flat, k, law.shear, law.bulk)) for k in range(count)
    ]
    if block.sliding:
        base = _symbol(stencils[-1][2], cosines, sines).reshape(-1, 3, 3)[:, :2, :2]
        base[0] = np.eye(2)
        inverse = np.linalg.inv(base)
        inverse[0] = 0  # holds the mean of the sliding base still
        S[count][:, [0, 1, 3]] = inverse[:, [0, 1, 0], [0, 1, 1]]

    def task(ranges: NDArray[np.int64]) -> None:
        some = slice(ranges[0, 0], ranges[-1, 1])
        for k in range(count - 1, -1, -1):
            C[k, some] = _symbol(stencils[k][1], cosines[some], sines[some])
            level = _symbol(stencils[k][0], cosines[some], sines[some])
            if k > 0:
                level += _symbol(stencils[k - 1][2], cosines[some], sines[some])
            _eliminate(level, C[k, some], S[k + 1, some], S[k, some])

    workers.share(task, pieces(waves, _WAVES))
    return Factor((nx, ny), S, C, workers)


def _phases(nx: int, ny: int) -> tuple[FloatArray, FloatArray]:
    """(waves, 9) cosines and sines of the phase between a node and its lateral
    neighbours.
    """
    ax, ay = 2 * np.pi * np.arange(nx // 2 + 1) / nx, 2 * np.pi * np.arange(ny) / ny
    ox, oy = np.repeat([-1, 0, 1], 3), np.tile([-1, 0, 1], 3)
    angle = (ax[:, None, None] * ox + ay[:, None] * oy).reshape(-1, 9)
    return np.cos(angle), np.sin(angle)


def _stencils(stiffness: FloatArray) -> FloatArray:
    """(3, 9 offsets, 3, 3) the top-top, top-bottom and bottom-bottom stencils of one
    layer.
    """
    K = stiffness.reshape(8, 3, 8, 3)
    out = np.zeros((3, 9, 3, 3))
    for a, (ax, ay, az) in enumerate(CORNERS):
        for b, (bx, by, bz) in enumerate(CORNERS):
            if az >= bz:
                out[2 - az - bz, 3 * (bx - ax + 1) + by - ay + 1] += K[a, :, b, :]
    return out


@compiled
def _symbol(stencil, cosines, sines):  # type: ignore[no-untyped-def]
    """(waves, 9) the real form of a stencil's transform, with u_z = i times the
    unknown.
    """
    out = np.zeros(cosines.shape)
    for q in range(out.shape[0]):
        for o in range(9):
            c, s = cosines[q, o], sines[q, o]
            for i in range(3):
                for j in range(3):
                    factor = c
                    if i < 2 and j == 2:  # xz, yz
                        factor = -s
                    elif i == 2 and j < 2:  # zx, zy
                        factor = s
                    out[q, 3 * i + j] += factor * stencil[o, i, j]
    return out


@njit(**OPTIONS)
def _eliminate(A, C, below, S):  # type: ignore[no-untyped-def]
    """S <- (A - C below C^T)^-1 for every wave."""
    D, B, T = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for q in range(A.shape[0]):
        s, c = below[q], C[q]
        B[0, 0], B[1, 1], B[2, 2] = s[0], s[1], s[2]
        B[0, 1] = B[1, 0] = s[3]
        B[1, 2] = B[2, 1] = s[4]
        B[0, 2] = B[2, 0] = s[5]
        for i in range(3):
            for j in range(3):
                T[i, j] = (
                    c[3 * i] * B[0, j] + c[3 * i + 1] * B[1, j] + c[3 * i + 2] * B[2, j]
                )
        for i in range(3):
            for j in range(3):
                D[i, j] = A[q, 3 * i + j] - (
                    T[i, 0] * c[3 * j] + T[i, 1] * c[3 * j + 1] + T[i, 2] * c[3 * j + 2]
                )
        a, b, d = D[0, 0], D[1, 1], D[2, 2]
        e, f, g = (
            (D[0, 1] + D[1, 0]) / 2,
            (D[1, 2] + D[2, 1]) / 2,
            (D[2, 0] + D[0, 2]) / 2,
        )
        det = a * (b * d - f * f) - e * (e * d - f * g) + g * (e * f - b * g)
        S[q, 0], S[q, 1] = (b * d - f * f) / det, (a * d - g * g) / det
        S[q, 2], S[q, 3] = (a * b - e * e) / det, (f * g - e * d) / det
        S[q, 4], S[q, 5] = (e * g - a * f) / det, (e * f - b * g) / det


@compiled
def _down(f, S, C, waves):  # type: ignore[no-untyped-def]
    """Eliminate from the lowest level given to the top, in place; f is (levels, waves,
    3).
    """
    for k in range(f.shape[0] - 2, -1, -1):
        for q in range(waves[0, 0], waves[-1, 1]):
            s, c = S[k + 1, q], C[k, q]
            x, y, z = f[k + 1, q, 0], f[k + 1, q, 1], f[k + 1, q, 2] * -1j
            a = s[0] * x + s[3] * y + s[5] * z
            b = s[3] * x + s[1] * y + s[4] * z
            d = s[5] * x + s[4] * y + s[2] * z
            f[k, q, 0] -= c[0] * a + c[1] * b + c[2] * d
            f[k, q, 1] -= c[3] * a + c[4] * b + c[5] * d
            f[k, q, 2] -= 1j * (c[6] * a + c[7] * b + c[8] * d)


@compiled
def _up(f, S, C, waves):  # type: ignore[no-untyped-def]
    """Solve from the top to the lowest level given, in place."""
    for k in range(f.shape[0]):
        for q in range(waves[0, 0], waves[-1, 1]):
            s = S[k, q]
            x, y, z = f[k, q, 0], f[k, q, 1], f[k, q, 2] * -1j
            if k > 0:
                c = C[k - 1, q]
                a, b, d = f[k - 1, q, 0], f[k - 1, q, 1], f[k - 1, q, 2] * -1j
                x -= c[0] * a + c[3] * b + c[6] * d
                y -= c[1] * a + c[4] * b + c[7] * d
                z -= c[2] * a + c[5] * b + c[8] * d
            f[k, q, 0] = s[0] * x + s[3] * y + s[5] * z
            f[k, q, 1] = s[3] * x + s[1] * y + s[4] * z
            f[k, q, 2] = 1j * (s[5] * x + s[4] * y + s[2] * z)


@compiled
def _continue(level, S, C, out, waves):  # type: ignore[no-untyped-def]
    """Solve from below the `level` (waves, 3) to the base, where no force acts."""
    for k in range(out.shape[0]):
        for q in range(waves[0, 0], waves[-1, 1]):
            s, c = S[k, q], C[k, q]
            if k == 0:
                a, b, d = level[q, 0], level[q, 1], level[q, 2] * -1j
            else:
                a, b, d = out[k - 1, q, 0], out[k - 1, q, 1], out[k - 1, q, 2] * -1j
            x = -(c[0] * a + c[3] * b + c[6] * d)
            y = -(c[1] * a + c[4] * b + c[7] * d)
            z = -(c[2] * a + c[5] * b + c[8] * d)
            out[k, q, 0] = s[0] * x + s[3] * y + s[5] * z
            out[k, q, 1] = s[3] * x + s[1] * y + s[4] * z
            out[k, q, 2] = 1j * (s[5] * x + s[4] * y + s[2] * z)


def transform(field: FloatArray, workers: Workers = ALONE) -> ComplexArray:
    """Lateral transform of (levels, nx, ny, 3) displacements or of an (nx, ny) surface
    field.
    """
    if field.ndim == 2:
        surface: ComplexArray = ducc0.fft.r2c(field, axes=(1, 0), nthreads=1)
        return surface
    levels, nx, ny, _ = field.shape
    out = np.empty((levels, nx // 2 + 1, ny, 3), dtype=complex)

    def task(ranges: NDArray[np.int64]) -> None:
        for first, stop in ranges:
            ducc0.fft.r2c(
                field[first:stop], axes=(2, 1), out=out[first:stop], nthreads=1
            )

    _share_levels(workers, task, field.shape)
    return out


def inverse(spectrum: ComplexArray, nx: int, workers: Workers = ALONE) -> FloatArray:
    """The inverse of `transform`, which may overwrite the `spectrum` of a
    displacement.
    """
    options = {"lastsize": nx, "forward": False, "inorm": 2, "nthreads": 1}
    if spectrum.ndim == 2:
        surface: FloatArray = ducc0.fft.c2r(spectrum, axes=(1, 0), **options)
        return surface
    levels, _, ny, _ = spectrum.shape
    out = np.empty((levels, nx, ny, 3))

    def task(ranges: NDArray[np.int64]) -> None:
        for first, stop in ranges:
            given, result = spectrum[first:stop], out[first:stop]
            ducc0.fft.c2r(
                given, axes=(2, 1), out=result, allow_overwriting_input=True, **options
            )

    _share_levels(workers, task, out.shape)
    return out


def _share_levels(
    workers: Workers, task: Callable[[NDArray[np.int64]], None], shape: tuple[int, ...]
) -> None:
    """Call `task` with the same ranges of levels on any threads: others would round
    otherwise.
    """
    size = shape[1] * shape[2]
    workers.share(
        task, pieces(shape[0], max(1, _NODES_AT_ONCE // size)), weight=size / 4
    )


def eliminate(factor: Factor, force: FloatArray) -> ComplexArray:
    """The transformed `force` (levels, nx, ny, 3) after the sweep up; below it none
    acts.
    """
    spectrum = transform(force, factor.workers)
    waves = spectrum.reshape(len(spectrum), -1, 3)
    _share(factor, partial(_down, waves, factor.compliances, factor.couplings))
    return spectrum


def top_descent(factor: Factor, eliminated: ComplexArray) -> FloatArray:
    """(nx, ny) downward displacement of the top under the eliminated force, in m."""
    s, f = factor.compliances[0].T, eliminated[0].reshape(-1, 3).T
    w = 1j * (s[5] * f[0] + s[4] * f[1] + s[2] * (-1j * f[2]))
    return -inverse(w.reshape(eliminated.shape[1:3]), factor.shape[0])


def substitute(
    factor: Factor, eliminated: ComplexArray, contact_forces: FloatArray
) -> FloatArray:
    """The displacement under the eliminated force, which it overwrites, and
    `contact_forces`.
    """
    eliminated[0, :, :, 2] -= transform(contact_forces)
    waves = eliminated.reshape(len(eliminated), -1, 3)
    _share(factor, partial(_up, waves, factor.compliances, factor.couplings))
    return inverse(eliminated, factor.shape[0], factor.workers)


def extend_to_base(factor: Factor, level: FloatArray, above: int) -> FloatArray:
    """The displacement below the first `above` levels, of which the last has the given
    one.
    """
    top = transform(level[None]).reshape(-1, 3)
    nx, ny = factor.shape
    below = np.empty(
        (len(factor.compliances) - above, nx // 2 + 1, ny, 3), dtype=complex
    )
    S, C = factor.compliances[above:], factor.couplings[above - 1 :]
    _share(factor, partial(_continue, top, S, C, below.reshape(len(below), -1, 3)))
    return inverse(below, nx, factor.workers)


def _share(factor: Factor, task: Callable[[NDArray[np.int64]], Any]) -> None:
    """Call `task` with parts of the waves."""
    factor.workers.share(task, pieces(factor.compliances.shape[1], _WAVES))
