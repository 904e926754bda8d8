"""The pass over the grid behind `area.estimate_areas`: what every row and column meets.

The constants are those of the discrete problem at a straight front; `rim_calibration` derives
and prints them.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.area_line import AXIS_OFFSET
from epcontact.results import ELASTIC

FloatArray = NDArray[np.float64]

#: Offset of a rim in grid spacings: the mean over its directions, and per switch of a line.
MEAN_OFFSET = 0.12908
RIM_PER_SWITCH = math.pi / 4 * MEAN_OFFSET
#: Offset per crossing of a strip with m = 0, 1 (by tau) and 2 elastic points in it.
TAU_NODES = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0])
STRIP_0 = np.array([0, 0.034, 0.0697, 0.1293, 0.1866, 0.2349, 0.2663, 0.2855, 0.3091, 0.3329])
STRIP_1 = np.array([0, 0.0223, 0.0444, 0.0581, 0.0657, 0.0765, 0.0843, 0.0878, 0.0937, 0.1026])
STRIP_2 = 0.1054
#: Switches in line are a straight rim from these numbers on; a rim of any direction has as many of
#: them that their excess over RIM_PER_SWITCH is ISOTROPIC_EXCESS per switch.
STRAIGHT_FROM, LOCATED_FROM = 12, 48
ISOTROPIC_EXCESS = 0.0052

_jit = numba.njit(cache=True, nogil=True)
# Places in the vector of sums.
RIM, PLASTIC_RIM, STRIP, STRIP_OFFSET = range(4)
LINE, LOCATED, LINE_SQUARES = 4, 6, 8  # of the contact; those of the plastic part follow
_BLOCK = 64  # columns swept together: their states stay in the innermost cache


@_jit
def count(pressure: FloatArray, hardness: float) -> tuple[int, int, int, int]:
    """Points in contact and at the hardness, and switches of either along rows and columns."""
    nx, ny = pressure.shape
    contact = plastic = contact_switches = plastic_switches = 0
    for i in range(nx):
        for j in range(ny):
            p = pressure[i, j]
            touching, flowing = p > 0, p >= hardness
            contact += touching
            plastic += flowing
            if ny > 1:
                q = pressure[i, j - 1]
                contact_switches += touching != (q > 0)
                plastic_switches += flowing != (q >= hardness)
            q = pressure[i - 1, j]
            contact_switches += touching != (q > 0)
            plastic_switches += flowing != (q >= hardness)
    return contact, plastic, contact_switches, plastic_switches


@_jit
def _close(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    stiffness: float,
    sums: FloatArray,
    ends: tuple[int, int],
) -> None:
    """Book a run of elastic points of a column between two that are apart or plastic."""
    top, bottom = ends[0], ends[1] % pressure.size
    run = ends[1] - top - 1
    plastic = pressure[top] >= hardness
    if plastic == (pressure[bottom] >= hardness):
        if run > 0:
            sums[PLASTIC_RIM if plastic else RIM] += 2
    elif run > 2:
        sums[RIM] += 1
        sums[PLASTIC_RIM] += 1
    else:
        sums[STRIP] += 1
        tau = hardness / (hardness + stiffness * abs(gap[top] - gap[bottom]))
        if run == 2:
            sums[STRIP_OFFSET] += STRIP_2
        else:
            sums[STRIP_OFFSET] += np.interp(tau, TAU_NODES, STRIP_0 if run == 0 else STRIP_1)


@_jit
def _close_line(sums: FloatArray, front: int, side: int, length: int, shift: float) -> None:
    """Book that many switches in line, with the sum of their located positions in the cell."""
    if side == 0:
        return
    sums[LINE + front] += _straight(length)
    if length >= LOCATED_FROM:
        sums[LOCATED + front] += shift
    elif length >= STRAIGHT_FROM:
        sums[LINE_SQUARES + front] += length * length


@_jit
def _shift(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    stiffness: float,
    place: tuple[int, int, int],
) -> float:
    """How far beyond the middle between points (i, j - 1) and (i, j) the front is located, in
    grid spacings, away from the contact, or from what is not plastic."""
    i, j, front = place
    here = _field(pressure[i, j], gap[i, j], hardness, stiffness, front)
    there = _field(pressure[i, j - 1], gap[i, j - 1], hardness, stiffness, front)
    if here == there:
        return 0.0
    return float(max(here, there) / abs(here - there) - 0.5)


@_jit
def _field(p: float, g: float, hardness: float, stiffness: float, front: int) -> float:
    """p - c g, or hardness - p + c g at the plastic front; elastic points have no gap."""
    if 0 < p < hardness:
        g = 0.0
    field = p - math.pi / (2 * math.e) * stiffness * g
    return hardness - field if front else field


@_jit
def _straight(length: int) -> float:
    """Excess offset of that many switches in line, as one of a rim of slope 1/length has it.

    A fit to `rim_calibration.front_offset`, good to 1e-3 of it.
    """
    if length < STRAIGHT_FROM:
        return 0.0
    return (AXIS_OFFSET - RIM_PER_SWITCH) * length - math.log(length) / (2 * math.pi) - 0.098


@_jit
def _kind(p: float, hardness: float) -> int:
    """APART, ELASTIC or PLASTIC."""
    return int(p > 0) + int(p >= hardness)


@_jit
def sweep(
    pressure: FloatArray, gap: FloatArray, hardness: float, stiffness: float, sums: FloatArray
) -> None:
    """Follow every column [:, j] down the rows: its strips, and switches to column j - 1."""
    ny = pressure.shape[1]
    for start in range(0, ny, _BLOCK):
        _sweep_block(pressure, gap, hardness, stiffness, sums, (start, min(start + _BLOCK, ny)))


@_jit
def _sweep_block(  # noqa: PLR0912 - one pass over memory
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    stiffness: float,
    sums: FloatArray,
    columns: tuple[int, int],
) -> None:
    nx, (begin, end) = pressure.shape[0], columns
    above = np.empty(end - begin, np.int64)
    # Ends (points apart or plastic) at the two sides of a run of elastic points: the first end
    # of the column, to close it with at the bottom, and the last one.  Row -1: none yet.
    first, last = np.full(end - begin, -1), np.full(end - begin, -1)
    side = np.zeros((2, end - begin), np.int64)  # of each front, to column j - 1: 1 in, -1 out
    length, shift = np.zeros((2, end - begin), np.int64), np.zeros((2, end - begin))
    for i in range(nx):
        left = _kind(pressure[i, begin - 1], hardness)
        for k in range(end - begin):
            j = begin + k
            here = _kind(pressure[i, j], hardness)
            if i == 0:
                above[k] = here
                first[k] = 0 if here != ELASTIC else -1
            if here == above[k] and here == left and side[0, k] == 0 and side[1, k] == 0:
                continue
            for front in range(2):
                now = int(here > front) - int(left > front)
                if now != side[front, k]:
                    _close_line(sums, front, side[front, k], length[front, k], shift[front, k])
                    side[front, k], length[front, k], shift[front, k] = now, 0, 0.0
                if now != 0:
                    length[front, k] += 1
                    shift[front, k] += _shift(pressure, gap, hardness, stiffness, (i, j, front))
            if here != above[k]:
                if above[k] != ELASTIC:
                    last[k] = i - 1
                if here != ELASTIC:
                    if first[k] < 0:
                        first[k] = i
                    if last[k] >= 0:
                        _close(pressure[:, j], gap[:, j], hardness, stiffness, sums, (last[k], i))
            above[k] = left = here
    for k in range(end - begin):
        for front in range(2):
            _close_line(sums, front, side[front, k], length[front, k], shift[front, k])
        if first[k] >= 0:
            j, bottom = begin + k, nx - 1 if above[k] != ELASTIC else last[k]
            _close(pressure[:, j], gap[:, j], hardness, stiffness, sums, (bottom, first[k] + nx))
