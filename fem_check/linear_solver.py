"""The exact inverse of the elastic flat block: lateral Fourier transforms and sweeps.

A lateral transform splits the stiffness of flat layers of equal bricks, wave by wave,
into a block-tridiagonal matrix of 3 x 3 blocks A_k (level k with itself) and C_k (with
level k + 1), which are real once u_z is replaced by i u_z.  Elimination from the base
to the top,

    S_k = (A_k - C_k S_{k+1} C_k^T)^-1,   f_k <- f_k - C_k S_{k+1} f_{k+1},

leaves S_0 on the top level, whose normal entry is the compliance of the surface.  The
sweep back is u_{k+1} = S_{k+1} (f_{k+1} - C_k^T u_k).  Contact forces act on the top
only: they are computed between the two sweeps, on the surface alone (`contact`).

Half of the spectrum is stored along x, so that the spectrum of a line (ny = 1) is
halved, too.
"""

# mypy: allow-untyped-defs
# numba infers the types of the compiled functions.

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
from fem_check.lanes import OPTIONS, compiled, inlined
from fem_check.mesh import PeriodicBlock
from fem_check.plasticity import J2Law
from fem_check.workers import SERIAL, Workers, split_range

#: Nodes that one transform takes, approximately: few enough that threads can share the
#: levels, and enough that the calls cost little.
_NODES_PER_TRANSFORM = 8192
#: Waves that one thread takes at a time.
_WAVES_PER_RANGE = 256

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class Factor:
    """The factorised flat elastic block with (nx // 2 + 1) ny waves.

    Attributes:
        shape: (nx, ny) nodes of a level.
        compliances: (nz + 1, waves, 6) entries xx, yy, zz, xy, yz, zx of S_k, in m/N.
        couplings: (nz, waves, 9) C_k row by row, in N/m.
        workers: threads that share the work.
    """

    shape: tuple[int, int]
    compliances: FloatArray
    couplings: FloatArray
    workers: Workers = SERIAL

    @property
    def surface(self) -> FloatArray:
        """Normal displacement of the block's top per nodal force of each wave, in m/N.

        The shape is (nx // 2 + 1, ny): half of the spectrum along x.
        """
        nx, ny = self.shape
        return self.compliances[0, :, 2].reshape(nx // 2 + 1, ny)


def factorise(
    block: PeriodicBlock, flat: Elements, law: J2Law, workers: Workers = SERIAL
) -> Factor:
    """Factorise the elastic stiffness of a flat block wave by wave.

    Args:
        block: the periodic block.
        flat: its elements with a flat top, one shape per layer.
        law: of the material, whose two elastic moduli are used.
        workers: threads that share the work, here and in all later solves.

    Returns:
        The factor, with which `eliminate` and `substitute` solve exactly.
    """
    nx, ny = block.shape
    nz = len(block.layers)
    waves = (nx // 2 + 1) * ny
    cosines, sines = _phases(nx, ny)
    S = np.zeros((nz + 1, waves, 6))
    C = np.empty((nz, waves, 9))
    moduli = law.shear_modulus, law.bulk_modulus
    stencils = [_stencils(elastic_stiffness(flat, k, *moduli)) for k in range(nz)]
    if block.sliding:
        base = _symbol(stencils[-1][2], cosines, sines).reshape(-1, 3, 3)[:, :2, :2]
        # The mean of the sliding base is held: no force resists its motion.
        base[0] = np.eye(2)
        inverse = np.linalg.inv(base)
        inverse[0] = 0
        S[nz][:, [0, 1, 3]] = inverse[:, [0, 1, 0], [0, 1, 1]]

    def eliminate_levels(ranges: NDArray[np.int64]) -> None:
        """Write the compliances S and the couplings C of some waves, from the base up.

        `ranges` (r, 2) holds the first wave and the stop wave of consecutive ranges.
        """
        part = slice(ranges[0, 0], ranges[-1, 1])
        for k in range(nz - 1, -1, -1):
            top, coupling, _ = stencils[k]
            C[k, part] = _symbol(coupling, cosines[part], sines[part])
            level = _symbol(top, cosines[part], sines[part])
            if k > 0:
                level += _symbol(stencils[k - 1][2], cosines[part], sines[part])
            _eliminate(level, C[k, part], S[k + 1, part], S[k, part])

    workers.run(eliminate_levels, split_range(waves, _WAVES_PER_RANGE))
    return Factor((nx, ny), S, C, workers)


def _phases(nx: int, ny: int) -> tuple[FloatArray, FloatArray]:
    """Return cosines and sines of the phases between a node and its neighbours.

    Both are (waves, 9): wave q_x ny + q_y of the (nx // 2 + 1) ny waves of a grid with
    (nx, ny) nodes, and offset 3 (dx + 1) + dy + 1 with dx, dy = -1, 0, 1.
    """
    angle_x = 2 * np.pi * np.arange(nx // 2 + 1) / nx
    angle_y = 2 * np.pi * np.arange(ny) / ny
    offset_x = np.repeat([-1, 0, 1], 3)
    offset_y = np.tile([-1, 0, 1], 3)
    angle = angle_x[:, None, None] * offset_x + angle_y[:, None] * offset_y
    angle = angle.reshape(-1, 9)
    return np.cos(angle), np.sin(angle)


def _stencils(stiffness: FloatArray) -> FloatArray:
    """Return the stencils of one layer of equal elements, in N/m.

    Args:
        stiffness: (24, 24) of one element in N/m, with rows 3 corner + component.

    Returns:
        (3, 9, 3, 3): the top level with itself, top with bottom, and bottom with
        itself; then the neighbour at offset 3 (dx + 1) + dy + 1, and the components of
        force and displacement.
    """
    K = stiffness.reshape(8, 3, 8, 3)
    stencils = np.zeros((3, 9, 3, 3))
    for a, (ax, ay, az) in enumerate(CORNERS):
        for b, (bx, by, bz) in enumerate(CORNERS):
            if az >= bz:
                offset = 3 * (bx - ax + 1) + by - ay + 1
                stencils[2 - az - bz, offset] += K[a, :, b, :]
    return stencils


@compiled
def _symbol(stencil, cosines, sines):
    """Return the real lateral Fourier transform of a stencil, for each wave.

    It is real because u_z is replaced by i u_z.

    Args:
        stencil: (9, 3, 3) stiffness between a node and its nine neighbours, in N/m.
        cosines: (waves, 9) of the phases from `_phases`.
        sines: (waves, 9) of these phases.

    Returns:
        (waves, 9) 3 x 3 matrices row by row, in N/m.
    """
    symbol = np.zeros(cosines.shape)
    for q in range(symbol.shape[0]):
        for offset in range(9):
            cosine = cosines[q, offset]
            sine = sines[q, offset]
            for i in range(3):
                for j in range(3):
                    factor = cosine
                    if i < 2 and j == 2:  # xz, yz
                        factor = -sine
                    elif i == 2 and j < 2:  # zx, zy
                        factor = sine
                    symbol[q, 3 * i + j] += factor * stencil[offset, i, j]
    return symbol


@inlined
def _times_symmetric(s, x, y, z):
    """Return a symmetric 3 x 3 matrix times the vector (x, y, z), as three numbers.

    `s` holds the six entries xx, yy, zz, xy, yz, zx of the matrix.
    """
    return (
        s[0] * x + s[3] * y + s[5] * z,
        s[3] * x + s[1] * y + s[4] * z,
        s[5] * x + s[4] * y + s[2] * z,
    )


@njit(**OPTIONS)
def _eliminate(A, C, below, S):
    """Write (A - C below C^T)^-1 of each wave to S: the compliance of a level.

    3 x 3 matrices have nine entries row by row, symmetric ones xx, yy, zz, xy, yz, zx.

    Args:
        A: (waves, 9) stiffness of the level with itself, in N/m.
        C: (waves, 9) stiffness between the level and the next one below, in N/m.
        below: (waves, 6) compliance of the level below, in m/N.
        S: (waves, 6) receives the compliance, in m/N.
    """
    D = np.empty((3, 3))
    for q in range(A.shape[0]):
        c = C[q]
        for i in range(3):
            x, y, z = _times_symmetric(below[q], c[3 * i], c[3 * i + 1], c[3 * i + 2])
            for j in range(3):
                product = x * c[3 * j] + y * c[3 * j + 1] + z * c[3 * j + 2]
                D[i, j] = A[q, 3 * i + j] - product
        xx = D[0, 0]
        yy = D[1, 1]
        zz = D[2, 2]
        xy = (D[0, 1] + D[1, 0]) / 2
        yz = (D[1, 2] + D[2, 1]) / 2
        zx = (D[2, 0] + D[0, 2]) / 2
        # `invert_symmetric` with strict arithmetic.
        cofactor_xx = yy * zz - yz * yz
        cofactor_zx = xy * yz - yy * zx
        determinant = xx * cofactor_xx - xy * (xy * zz - yz * zx) + zx * cofactor_zx
        S[q, 0] = cofactor_xx / determinant
        S[q, 1] = (xx * zz - zx * zx) / determinant
        S[q, 2] = (xx * yy - xy * xy) / determinant
        S[q, 3] = (yz * zx - xy * zz) / determinant
        S[q, 4] = (xy * zx - xx * yz) / determinant
        S[q, 5] = cofactor_zx / determinant


# In the sweeps, the z components of forces and displacements are divided by i, which
# makes S and C real.


@compiled
def _sweep_up(f, S, C, waves):
    """Eliminate the forces of all levels below the top, from the lowest up, in place.

    Args:
        f: (levels, waves, 3) transformed forces in N, which are changed.
        S: (levels, waves, 6) compliances of the levels, in m/N.
        C: (levels - 1, waves, 9) couplings of neighbouring levels, in N/m.
        waves: (r, 2) first wave and stop wave of consecutive ranges.
    """
    for k in range(f.shape[0] - 2, -1, -1):
        for q in range(waves[0, 0], waves[-1, 1]):
            c = C[k, q]
            below = f[k + 1, q]
            x, y, z = _times_symmetric(S[k + 1, q], below[0], below[1], below[2] * -1j)
            f[k, q, 0] -= c[0] * x + c[1] * y + c[2] * z
            f[k, q, 1] -= c[3] * x + c[4] * y + c[5] * z
            f[k, q, 2] -= 1j * (c[6] * x + c[7] * y + c[8] * z)


@compiled
def _sweep_down(f, S, C, waves):
    """Turn eliminated forces into displacements, from the top level down, in place.

    Args:
        f: (levels, waves, 3) eliminated forces in N; receives the displacements in m.
        S: (levels, waves, 6) compliances of the levels, in m/N.
        C: (levels - 1, waves, 9) couplings of neighbouring levels, in N/m.
        waves: (r, 2) first wave and stop wave of consecutive ranges.
    """
    for k in range(f.shape[0]):
        for q in range(waves[0, 0], waves[-1, 1]):
            fx = f[k, q, 0]
            fy = f[k, q, 1]
            fz = f[k, q, 2] * -1j
            if k > 0:
                c = C[k - 1, q]
                x = f[k - 1, q, 0]
                y = f[k - 1, q, 1]
                z = f[k - 1, q, 2] * -1j
                fx -= c[0] * x + c[3] * y + c[6] * z
                fy -= c[1] * x + c[4] * y + c[7] * z
                fz -= c[2] * x + c[5] * y + c[8] * z
            x, y, z = _times_symmetric(S[k, q], fx, fy, fz)
            f[k, q, 0] = x
            f[k, q, 1] = y
            f[k, q, 2] = 1j * z


@compiled
def _sweep_below(level, S, C, u, waves):
    """Write the displacements of the levels below a given one, where no force acts.

    Args:
        level: (waves, 3) transformed displacement of the given level, in m.
        S: (levels, waves, 6) compliances of the levels below it, in m/N.
        C: (levels, waves, 9) coupling of each of them to the level above, in N/m.
        u: (levels, waves, 3) receives their displacements, in m.
        waves: (r, 2) first wave and stop wave of consecutive ranges.
    """
    for k in range(u.shape[0]):
        for q in range(waves[0, 0], waves[-1, 1]):
            s = S[k, q]
            c = C[k, q]
            if k == 0:
                x = level[q, 0]
                y = level[q, 1]
                z = level[q, 2] * -1j
            else:
                x = u[k - 1, q, 0]
                y = u[k - 1, q, 1]
                z = u[k - 1, q, 2] * -1j
            fx = -(c[0] * x + c[3] * y + c[6] * z)
            fy = -(c[1] * x + c[4] * y + c[7] * z)
            fz = -(c[2] * x + c[5] * y + c[8] * z)
            u[k, q, 0] = s[0] * fx + s[3] * fy + s[5] * fz
            u[k, q, 1] = s[3] * fx + s[1] * fy + s[4] * fz
            u[k, q, 2] = 1j * (s[5] * fx + s[4] * fy + s[2] * fz)


def transform(field: FloatArray, workers: Workers = SERIAL) -> ComplexArray:
    """Return the lateral Fourier transform of a field.

    Args:
        field: (levels, nx, ny, 3) of the block or (nx, ny) of its surface, in any unit.
        workers: threads that share the levels.

    Returns:
        Complex (levels, nx // 2 + 1, ny, 3) or (nx // 2 + 1, ny), not normalised.
    """
    if field.ndim == 2:
        surface: ComplexArray = ducc0.fft.r2c(field, axes=(1, 0), nthreads=1)
        return surface
    levels, nx, ny, _ = field.shape
    spectrum = np.empty((levels, nx // 2 + 1, ny, 3), dtype=complex)

    def transform_levels(ranges: NDArray[np.int64]) -> None:
        """Write the transforms of the levels in `ranges` (r, 2) to `spectrum`."""
        for first, stop in ranges:
            part = spectrum[first:stop]
            ducc0.fft.r2c(field[first:stop], axes=(2, 1), out=part, nthreads=1)

    _run_by_levels(workers, transform_levels, field.shape)
    return spectrum


def inverse_transform(
    spectrum: ComplexArray, nx: int, workers: Workers = SERIAL
) -> FloatArray:
    """Return the real field of a spectrum of `transform`.

    The spectrum of a block may be overwritten.

    Args:
        spectrum: (levels, nx // 2 + 1, ny, 3) of a block or (nx // 2 + 1, ny) of a
            surface.
        nx: number of nodes along x.
        workers: threads that share the levels.

    Returns:
        (levels, nx, ny, 3) or (nx, ny).
    """
    options = {"lastsize": nx, "forward": False, "inorm": 2, "nthreads": 1}
    if spectrum.ndim == 2:
        surface: FloatArray = ducc0.fft.c2r(spectrum, axes=(1, 0), **options)
        return surface
    levels, _, ny, _ = spectrum.shape
    field = np.empty((levels, nx, ny, 3))

    def transform_levels(ranges: NDArray[np.int64]) -> None:
        """Write the fields of the levels in `ranges` (r, 2) to `field`."""
        for first, stop in ranges:
            ducc0.fft.c2r(
                spectrum[first:stop],
                axes=(2, 1),
                out=field[first:stop],
                allow_overwriting_input=True,
                **options,
            )

    _run_by_levels(workers, transform_levels, field.shape)
    return field


def _run_by_levels(
    workers: Workers, task: Callable[[NDArray[np.int64]], None], shape: tuple[int, ...]
) -> None:
    """Call `task` with ranges of levels of a field, in several threads.

    The ranges are the same on any number of threads, because other ranges would change
    the rounding.

    Args:
        workers: the threads.
        task: called with (r, 2) first level and stop level of ranges.
        shape: (levels, nx, ny, 3) of the field.
    """
    nodes = shape[1] * shape[2]
    levels_per_range = max(1, _NODES_PER_TRANSFORM // nodes)
    workers.run(task, split_range(shape[0], levels_per_range), work=nodes / 4)


def _run_by_waves(factor: Factor, task: Callable[[NDArray[np.int64]], Any]) -> None:
    """Call `task` with ranges of waves, in the threads of the factor.

    Args:
        factor: of the block, with the number of waves and the threads.
        task: called with (r, 2) first wave and stop wave of consecutive ranges.
    """
    waves = factor.compliances.shape[1]
    factor.workers.run(task, split_range(waves, _WAVES_PER_RANGE))


def eliminate(factor: Factor, force: FloatArray) -> ComplexArray:
    """Return the transformed forces after the elimination from the base to the top.

    Args:
        factor: of the block.
        force: (levels, nx, ny, 3) on the upper levels, in N; no force acts below.

    Returns:
        Complex (levels, nx // 2 + 1, ny, 3) in N, for `top_descent` and `substitute`.
    """
    spectrum = transform(force, factor.workers)
    waves = spectrum.reshape(len(spectrum), -1, 3)
    _run_by_waves(
        factor, partial(_sweep_up, waves, factor.compliances, factor.couplings)
    )
    return spectrum


def top_descent(factor: Factor, eliminated: ComplexArray) -> FloatArray:
    """Return the (nx, ny) descent of the top in m, under eliminated forces.

    Args:
        factor: of the block.
        eliminated: complex (levels, nx // 2 + 1, ny, 3) forces from `eliminate`, in N.
    """
    s = factor.compliances[0].T
    x, y, z = eliminated[0].reshape(-1, 3).T
    upward = 1j * (s[5] * x + s[4] * y + s[2] * (-1j * z))
    upward = upward.reshape(eliminated.shape[1:3])
    return -inverse_transform(upward, factor.shape[0])


def substitute(
    factor: Factor, eliminated: ComplexArray, contact_forces: FloatArray
) -> FloatArray:
    """Return the displacements under eliminated forces and contact forces.

    Args:
        factor: of the block.
        eliminated: complex (levels, nx // 2 + 1, ny, 3) forces from `eliminate` in N,
            which are overwritten.
        contact_forces: (nx, ny) downward on the top, in N.

    Returns:
        (levels, nx, ny, 3) displacements of the upper levels, in m.
    """
    eliminated[0, :, :, 2] -= transform(contact_forces)
    waves = eliminated.reshape(len(eliminated), -1, 3)
    _run_by_waves(
        factor, partial(_sweep_down, waves, factor.compliances, factor.couplings)
    )
    return inverse_transform(eliminated, factor.shape[0], factor.workers)


def extend_to_base(factor: Factor, level: FloatArray, above: int) -> FloatArray:
    """Return the displacements below some levels, where no force acts.

    Args:
        factor: of the block.
        level: (nx, ny, 3) displacement of the lowest of these levels, in m.
        above: number of these levels, from the top.

    Returns:
        (nz + 1 - above, nx, ny, 3) in m.
    """
    nx, ny = factor.shape
    levels = len(factor.compliances) - above
    spectrum = np.empty((levels, nx // 2 + 1, ny, 3), dtype=complex)
    lowest = transform(level[None]).reshape(-1, 3)
    S = factor.compliances[above:]
    C = factor.couplings[above - 1 :]
    waves = spectrum.reshape(levels, -1, 3)
    _run_by_waves(factor, partial(_sweep_below, lowest, S, C, waves))
    return inverse_transform(spectrum, nx, factor.workers)
