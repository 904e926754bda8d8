"""Contact areas in the limit of a vanishing grid spacing, from one solution on a grid.

Counting grid points overestimates a contact by its rim: the points at which contact is asked for
stand in for the gaps between them.  By particle-hole symmetry (p -> hardness - p, g -> -g) the
count underestimates the plastic part as it overestimates the contact.

`perimeter_areas` is the published remedy (Yastrebov, Anciaux and Molinari, Tribology
International 114 (2017) 161): A = A_raw - (pi - 1 + ln 2)/24 S dx with S the length of the rim,
counted by the switches along rows and columns.  It takes off a sixth too much.

`estimate_areas` uses the exact offset of the counted rim instead, from the discrete problem at a
straight front (`rim_calibration`), as a sum over what each row and column meets:

* a switch between apart and elastic contact, or elastic and plastic: RIM_PER_SWITCH, the mean
  over the directions of a rim;
* m < 3 elastic points between apart and plastic: the two fronts see each other, and each is off
  by a tabulated amount that depends on m and on tau = H/(H + (E*/dx) |difference of the gaps|),
  down to nothing for a rigid-plastic body, tau -> 0;
* switches in line over STRAIGHT_FROM rows or columns: rims along the grid, whose offset is
  larger; what exceeds the share that a rim of any direction has is added.  From LOCATED_FROM on
  the front is also located inside its cells, by p - c g = 0, c = pi E*/(2 e dx), as on a line.

On a line fronts are located inside their cell, see `area_line`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.area_line import line_lengths
from epcontact.errors import InvalidScene
from epcontact.results import Areas

FloatArray = NDArray[np.float64]

#: Yastrebov, Anciaux and Molinari (2017): of a grid cell's area, for each switch.
PERIMETER_FACTOR = (math.pi - 1 + math.log(2)) / 24
#: Offset of a rim in grid spacings: mean over its directions, and along the grid's axes, where it
#: is 1/4 - (1/2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
MEAN_OFFSET = 0.12908
AXIS_OFFSET = 0.189965421265238
RIM_PER_SWITCH = math.pi / 4 * MEAN_OFFSET
#: Offset per crossing of a strip with m = 0, 1 (by tau) and 2 elastic points in it.
TAU_NODES = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0])
STRIP_0 = np.array([0, 0.034, 0.0709, 0.1278, 0.1859, 0.233, 0.2659, 0.2854, 0.3064, 0.326])
STRIP_1 = np.array([0, 0.0226, 0.0449, 0.0588, 0.0662, 0.0765, 0.0854, 0.0875, 0.0927, 0.1026])
STRIP_2 = 0.1052
#: Switches in line are a straight rim from these numbers on; a rim of any direction has as many of
#: them that their excess over RIM_PER_SWITCH is ISOTROPIC_EXCESS per switch.
STRAIGHT_FROM, LOCATED_FROM = 12, 48
ISOTROPIC_EXCESS = 0.0052

_jit = numba.njit(cache=True, nogil=True)
# Places in the vector of sums.
_CONTACT, _PLASTIC, _RIM, _PLASTIC_RIM, _STRIP, _STRIP_OFFSET = range(6)
_LINE, _LOCATED, _LINE_SQUARES = 6, 8, 10  # of the contact; those of the plastic part follow
_BLOCK = 64  # columns swept together: their states stay in the innermost cache


def perimeter_areas(pressure: FloatArray, hardness: float = math.inf) -> tuple[Areas, Areas]:
    """(raw, corrected) areas by the published perimeter correction.

    pressure: (nx, ny) or (nx,), in Pa, zero where apart and `hardness` (Pa) where plastic.  On a
    line, for which nothing is published, the exact offset AXIS_OFFSET stands in.
    """
    grid = pressure.reshape(pressure.shape[0], -1)
    contact, plastic, contact_switches, plastic_switches = _count(grid, hardness)
    factor = AXIS_OFFSET if pressure.ndim == 1 else PERIMETER_FACTOR
    raw = _areas(contact / grid.size, plastic / grid.size)
    total = (contact - factor * contact_switches) / grid.size
    return raw, _areas(total, (plastic + factor * plastic_switches) / grid.size)


def estimate_areas(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: Sequence[float],
    effective_modulus: float,
) -> tuple[Areas, Areas, Areas]:
    """(raw, corrected, error): areas as fractions of the nominal area.

    pressure, gap: (nx, ny) or (nx,) of a converged solution, in Pa and m: p = 0 where apart,
        p = hardness where plastic; spacing: dx, dy in m; hardness: in Pa, may be infinite;
        effective_modulus: E* in Pa (a layer's too: the rim is a matter of short waves).
    error: estimated absolute error of the corrected areas; meant to cover nine errors of ten.

    Validity: square cells; the offset of oblong ones has not been calibrated, their geometric
    mean spacing stands in.  Works in place, without arrays of the grid's size.

    Raises InvalidScene if the shapes do not fit.
    """
    if pressure.shape != gap.shape or len(spacing) != pressure.ndim or pressure.ndim > 2:
        raise InvalidScene(
            f"pressure {pressure.shape}, gap {gap.shape} and {len(spacing)} spacings do not fit: "
            "a line (nx,) or a grid (nx, ny) each and one spacing a direction are needed"
        )
    if pressure.ndim == 1:
        n = pressure.size
        lengths = line_lengths(pressure, gap, hardness, effective_modulus / spacing[0])
        counted, located, error = ((total / n, plastic / n) for total, plastic in lengths)
        return _areas(*counted), _areas(*located), _error(*error)
    stiffness = effective_modulus / math.sqrt(spacing[0] * spacing[1])
    sums = np.zeros(12)
    _sweep(pressure, gap, hardness, stiffness, sums)
    _sweep(pressure.T, gap.T, hardness, stiffness, sums)
    n = pressure.size
    contact, plastic = sums[_CONTACT] / 2, sums[_PLASTIC] / 2  # both sweeps count
    correction = _correction(sums, 0)
    plastic_correction = _correction(sums, 1)
    corrected = _areas((contact - correction) / n, (plastic + plastic_correction) / n)
    uncertain = (
        _uncertainty(sums, 0, correction, min(contact, n - contact)),
        _uncertainty(sums, 1, plastic_correction, min(plastic, n - plastic)),
    )
    return _areas(contact / n, plastic / n), corrected, _error(*(u / n for u in uncertain))


def _areas(total: float, plastic: float) -> Areas:
    return Areas(total=float(total), elastic=float(total - plastic), plastic=float(plastic))


def _error(total: float, plastic: float) -> Areas:
    return Areas(total=float(total), elastic=math.hypot(total, plastic), plastic=float(plastic))


def _correction(sums: FloatArray, front: int) -> float:
    """Cells to take off the contact (front 0), or to add to the plastic part (front 1)."""
    rim, line = sums[_RIM + front], sums[_LINE + front]
    switches = rim + sums[_STRIP]
    if switches == 0:
        return 0.0
    share = rim / switches
    longest = AXIS_OFFSET - RIM_PER_SWITCH
    excess = max(0.0, line - ISOTROPIC_EXCESS * switches) * share
    straight = excess * longest / (longest - ISOTROPIC_EXCESS)
    offset = RIM_PER_SWITCH * rim + sums[_STRIP_OFFSET] + straight
    return float(offset - sums[_LOCATED + front])


def _uncertainty(sums: FloatArray, front: int, correction: float, area: float) -> float:
    """Cells by which an area may be off; the figures are measured, see the tests.

    The rim's position in its cells is random, over a straight rim all at once; a next order falls
    with the size of the spots.
    """
    switches = sums[_RIM + front] + sums[_STRIP]
    chance = math.sqrt(0.16 * switches + 0.25 * sums[_LINE_SQUARES + front])
    order = 0.5 * correction * min(1.0, correction / max(area, 1.0))
    return math.hypot(chance, order, 0.05 * sums[_STRIP_OFFSET])


@_jit
def _count(pressure: FloatArray, hardness: float) -> tuple[int, int, int, int]:
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
def _close(sums: FloatArray, plastic: bool, was_plastic: bool, run: int, tau: float) -> None:
    """Book a run of elastic points between two that are apart or plastic."""
    if plastic == was_plastic:
        if run > 0:
            sums[_PLASTIC_RIM if plastic else _RIM] += 2
    elif run > 2:
        sums[_RIM] += 1
        sums[_PLASTIC_RIM] += 1
    else:
        sums[_STRIP] += 1
        if run == 2:
            sums[_STRIP_OFFSET] += STRIP_2
        else:
            sums[_STRIP_OFFSET] += np.interp(tau, TAU_NODES, STRIP_0 if run == 0 else STRIP_1)


@_jit
def _close_line(sums: FloatArray, front: int, length: int, shift: float) -> None:
    """Book that many switches in line, with the sum of their located positions in the cell."""
    sums[_LINE + front] += _straight(length)
    if length >= LOCATED_FROM:
        sums[_LOCATED + front] += shift
    elif length >= STRAIGHT_FROM:
        sums[_LINE_SQUARES + front] += length * length


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
def _sweep(  # noqa: PLR0912 - one pass over memory
    pressure: FloatArray, gap: FloatArray, hardness: float, stiffness: float, sums: FloatArray
) -> None:
    """Follow every column [:, j] down the rows: its strips, and switches to column j - 1."""
    nx, ny = pressure.shape
    for start in range(0, ny, _BLOCK):
        width = min(_BLOCK, ny - start)
        run, head = np.zeros(width, np.int64), np.zeros(width, np.int64)
        seen = np.zeros(width, np.bool_)
        ends = np.zeros((2, width), np.bool_)  # plastic? of the first end, of the last one
        gaps = np.zeros((2, width))
        side = np.zeros((2, width), np.int64)  # of contact, of plastic: +1 into it, -1 out, 0
        length = np.zeros((2, width), np.int64)
        shift = np.zeros((2, width))
        for i in range(nx):
            for k in range(width):
                p, q = pressure[i, start + k], pressure[i, start + k - 1]
                contact, plastic = p > 0, p >= hardness
                sums[_CONTACT] += contact
                sums[_PLASTIC] += plastic
                for front in range(2):
                    now = (p >= hardness) - (q >= hardness) if front else (p > 0) - (q > 0)
                    if now != side[front, k]:
                        if side[front, k] != 0:
                            _close_line(sums, front, length[front, k], shift[front, k])
                        side[front, k] = now
                        length[front, k] = 0
                        shift[front, k] = 0.0
                    length[front, k] += 1
                    if now != 0:
                        g, f = gap[i, start + k], gap[i, start + k - 1]
                        first = _field(p, g, hardness, stiffness, front)
                        second = _field(q, f, hardness, stiffness, front)
                        if first != second:
                            shift[front, k] += max(first, second) / abs(first - second) - 0.5
                if contact and not plastic:
                    run[k] += 1
                    continue
                g = gap[i, start + k]
                if seen[k]:
                    tau = hardness / (hardness + stiffness * abs(g - gaps[1, k]))
                    _close(sums, plastic, ends[1, k], run[k], tau)
                else:
                    seen[k], head[k] = True, run[k]
                    ends[0, k], gaps[0, k] = plastic, g
                ends[1, k], gaps[1, k], run[k] = plastic, g, 0
        for k in range(width):
            for front in range(2):
                if side[front, k] != 0:
                    _close_line(sums, front, length[front, k], shift[front, k])
            if seen[k]:
                tau = hardness / (hardness + stiffness * abs(gaps[0, k] - gaps[1, k]))
                _close(sums, ends[0, k], ends[1, k], run[k] + head[k], tau)
