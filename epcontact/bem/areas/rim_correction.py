"""The rim correction: contact areas in the limit of a vanishing grid spacing, from one solution.

Counting grid points overestimates a contact by its rim, because a point in contact stands for a
whole cell.  By particle-hole symmetry (p -> hardness - p, g -> -g) the count underestimates the
plastic part as it overestimates the contact.

`perimeter_areas` is the published remedy (Yastrebov, Anciaux and Molinari, Tribology
International 114 (2017) 161): A = A_raw - (pi - 1 + ln 2)/24 S dx with S the length of the rim,
counted by the switches along rows and columns.  It takes off a sixth too much.

`estimate_areas` locates the fronts inside the cells (`grid`; on a line, `line`) and corrects the
area A_located that they enclose.  In cells, with a front's length L in spacings, the contact is

    A = A_located - (integral of offset(u) + HARMONIC cos 4 theta along the front)
        + CORNER * (Euler number) - TIP * (number of tips)

and for the plastic part the offset and the tips have the opposite sign.

* First order: the offset of a located front is that of the discrete problem at a straight one, of
  any direction theta, with an elastic strip of any width u beside it.
* Second order: a smooth front has two local lengths, the radius of its curvature and the length
  over which the pressure departs from its square root.  The cubic of `front` takes care of the
  latter; the former integrates to the Euler number of the front's inside, so that CORNER,
  measured on a sphere (and, of the other sign, on a penny-shaped gap) holds for any shape.
* Not resolved: chance decides whether a gap (or plastic spot) narrower than a spacing contains a
  grid point.  If it does, it shows as tips.  Straight gaps whose widths are equally likely need
  STRAIGHT_TIP for each tip, round ones need nothing; TIP, between the two, is the only figure that
  was fitted to rough surfaces.

`epcontact.studies.rim` measures the constants and prints them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np

from epcontact.bem.areas import grid
from epcontact.bem.areas.front import AXIS_OFFSET, STIFFNESS
from epcontact.bem.areas.line import line_lengths
from epcontact.errors import InvalidScene
from epcontact.results import Areas, FloatArray

#: Share of a grid cell's area that each switch takes off (Yastrebov, Anciaux and Molinari, 2017).
PERIMETER_FACTOR = (math.pi - 1 + math.log(2)) / 24
#: Offset of a located front in spacings at grid.U_NODES (`rim.calibrate_strips`).
OFFSETS = np.array(
    [
        *(0.0, 0.0721, 0.1369, 0.1915, 0.2198, 0.2229, 0.215, 0.1934),
        *(0.18, 0.1743, 0.1695, 0.1784, 0.1778, 0.1788),
    ]
)
#: Amplitude of the offset's change with the direction of a front (`rim.calibrate_directions`).
HARMONIC = 0.0127
#: Cells that a spot lacks because its front is curved (`rim.calibrate_corner`).
CORNER = 0.6
#: Cells missed for each tip: by straight gaps (`rim.calibrate_straight_tip`), and as fitted to
#: rough surfaces (`rim.calibrate_rough_tip`).
STRAIGHT_TIP, TIP = 0.277, 0.24
#: The mean offset on oblong cells is 1 + OBLONG ln^2(dx/dy) times that on square ones; needed by
#: test_oblong_cells.
OBLONG = 0.057
#: If narrow strips make up more than this share of the fronts, the load determines their place.
PLACED_FROM = 0.7
# A pressure above this share of the hardness is plastic: the difference is rounding.
_ROUNDING = 1 - 1e-12


def perimeter_areas(pressure: FloatArray, hardness: float = math.inf) -> tuple[Areas, Areas]:
    """Areas by the published perimeter correction.

    Args:
        pressure: (nx, ny) or (nx,), in Pa, zero where apart and `hardness` where plastic.
        hardness: in Pa.

    Returns:
        (raw, corrected).  On a line, for which nothing is published, each edge is moved by the
        exact AXIS_OFFSET.

    Example:
        >>> pressure = np.zeros((8, 8))
        >>> pressure[2:5, 3:7] = 1.0
        >>> raw, corrected = perimeter_areas(pressure)
        >>> raw.total * 64, round(corrected.total * 64, 2)
        (12.0, 10.35)
    """
    rows, hardness = pressure.reshape(pressure.shape[0], -1), hardness * _ROUNDING
    contact, plastic, contact_switches, plastic_switches = count(rows, hardness)
    factor = AXIS_OFFSET if pressure.ndim == 1 else PERIMETER_FACTOR
    raw = _areas(contact / rows.size, plastic / rows.size)
    total = (contact - factor * contact_switches) / rows.size
    return raw, _areas(total, (plastic + factor * plastic_switches) / rows.size)


def estimate_areas(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: Sequence[float],
    effective_modulus: float,
) -> tuple[Areas, Areas, Areas]:
    """Areas as fractions of the nominal area, from one converged solution.

    Oblong cells are right on average over directions up to dx/dy = 2; beyond, and for fronts of
    one direction, the error grows.  No array of the grid's size is made.

    Args:
        pressure: (nx, ny) or (nx,), in Pa: 0 where apart, the hardness where plastic.
        gap: of the same shape, in m.
        hardness: in Pa, may be infinite.
        spacing: (dx, dy) or (dx,), in m.
        effective_modulus: E* in Pa, also for a layer, because short waves determine a rim.

    Returns:
        (raw, corrected, error).  The error is the estimated absolute error of the corrected
        areas; it is meant to cover nine out of ten errors.

    Raises:
        InvalidScene: the shapes do not fit.

    Example:
        >>> pressure, gap = np.array([2.0, 1.0, 0.0, 0.0, 1.0]), np.array([0.0, 0, 1, 1, 0])
        >>> raw, corrected, error = estimate_areas(pressure, gap, math.inf, [0.2], 1.0)
        >>> raw.total, corrected.total < raw.total
        (0.6, True)
    """
    if pressure.shape != gap.shape or len(spacing) != pressure.ndim or pressure.ndim > 2:
        raise InvalidScene(
            f"pressure {pressure.shape}, gap {gap.shape} and {len(spacing)} spacings do not fit: "
            "a line (nx,) or a grid (nx, ny) each and one spacing a direction are needed"
        )
    share = float(pressure.mean()) / hardness
    hardness, n = hardness * _ROUNDING, pressure.size
    if pressure.ndim == 1:
        lengths = line_lengths(pressure, gap, hardness, effective_modulus / spacing[0])
        counted, located, error = ((total / n, plastic / n) for total, plastic in lengths)
        return _areas(*counted), *_possible(located, error, share)
    stiffness = [STIFFNESS * effective_modulus / step for step in spacing]
    sums = np.zeros(grid.SUMS)
    grid.sweep(pressure, gap, hardness, (stiffness[0], stiffness[1]), OFFSETS, sums)
    contact, plastic, _, _ = count(pressure, hardness)
    oblong = OBLONG * math.log(spacing[0] / spacing[1]) ** 2
    placed = _placed([corrected(sums, front, oblong) / n for front in range(2)], sums, share)
    less = (min(contact, n - contact), min(plastic, n - plastic))
    errors = tuple(_uncertainty(sums, front, less[front], oblong) / n for front in range(2))
    if math.isinf(hardness):
        errors = (errors[0], 0.0)
    return (
        _areas(contact / n, plastic / n),
        *_possible(placed, (errors[0], errors[1]), share),
    )


@numba.njit(cache=True, nogil=True)
def count(pressure: FloatArray, hardness: float) -> tuple[int, int, int, int]:
    """Numbers of points in contact and at the hardness, and of switches of each along the axes."""
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


def _possible(
    areas: tuple[float, float], errors: tuple[float, float], share: float
) -> tuple[Areas, Areas]:
    """Move the total and plastic area to the nearest values that carry the load; add to the errors.

    A plastic area above share = p0/hardness carries too much, and a contact below it too little.
    The distance moved adds to the error: if nothing of a contact is resolved, the estimate is worth
    no more than the bound.
    """
    bounds = ((share, 1.0), (0.0, share))
    moved = [min(max(a, low), high) for a, (low, high) in zip(areas, bounds, strict=True)]
    widened = [e + abs(m - a) for e, m, a in zip(errors, moved, areas, strict=True)]
    return _areas(*moved), _error(*widened)


def _areas(total: float, plastic: float) -> Areas:
    return Areas(total=float(total), elastic=float(total - plastic), plastic=float(plastic))


def _error(total: float, plastic: float) -> Areas:
    return Areas(total=float(total), elastic=math.hypot(total, plastic), plastic=float(plastic))


def corrected(sums: FloatArray, front: int, oblong: float) -> float:
    """The corrected area of the contact (front 0) or of the plastic part (front 1), in cells.

    sums: of `grid.sweep`; oblong: OBLONG ln^2(dx/dy).
    """
    offset = (1 + oblong) * sums[grid.OFFSET + front] + HARMONIC * sums[grid.HARMONIC + front]
    outward = offset + TIP * sums[grid.TIPS + front]
    side = -1 if front == 0 else 1
    return float(sums[grid.AREA + front] + side * outward + CORNER * sums[grid.TURN + front])


def _placed(areas: list[float], sums: FloatArray, share: float) -> tuple[float, float]:
    """Shift the total and plastic area so that the middle of the strips agrees with the load.

    Across a narrow strip the pressure rises antisymmetrically, so that strips alone have
    (A + A_pl)/2 = p0/hardness.  The weight of the shift grows from 0 where strips are PLACED_FROM
    of the fronts to 1 where they are all.
    """
    length = sums[grid.LENGTH] + sums[grid.LENGTH + 1]
    strips = (sums[grid.STRIP] + sums[grid.STRIP + 1]) / length if length else 0.0
    weight = max(0.0, (strips - PLACED_FROM) / (1 - PLACED_FROM))
    shift = weight * (share - (areas[0] + areas[1]) / 2)
    return areas[0] + shift, areas[1] + shift


def _uncertainty(sums: FloatArray, front: int, area: float, oblong: float) -> float:
    """Cells by which an area may be off.

    area: cells inside the front or outside of it, whichever are fewer.

    Random errors grow as the square root of a front's length; they are its position in its cells,
    the tips found by chance, and the dips, which are a bound.  Errors common to a whole front grow
    as its length; they are the errors of its offset, corners and tips, a remainder of the second
    order that grows as fronts come closer, and the change of the offset where a front runs in one
    direction.  The factors are measured on rough surfaces.
    """
    length, strip = sums[grid.LENGTH + front], sums[grid.STRIP + front]
    tips, others = sums[grid.TIPS + front], sums[grid.TIPS + 1 - front]
    chance = 0.006 * length + 0.08 * strip + 0.5 * tips + sums[grid.DIPS + front]
    common = (
        0.0015 * length,
        0.003 * strip,
        0.009 * length * length / max(area, 1.0),
        0.1 * tips + 0.04 * others,
        0.05 * sums[grid.TURN + front],
        oblong * sums[grid.OFFSET + front],
        0.01 * abs(sums[grid.HARMONIC + front]),
    )
    return math.hypot(math.sqrt(chance), *common)
