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
  grid point.  If it does, it shows as tips.  TIP is what straight gaps whose widths are equally
  likely need for each tip; round ones need nothing.
* Held by an edge: where the surface has a step or a kink, the front rests on it, somewhere between
  two points.  `front` recognises it by the singular pressure and puts the front in the middle, so
  that the count is right there.  These parts of a front have no offset.

The load is one more measurement of the areas (`_balanced`), and the estimated errors follow from
the same sums (`_uncertainty`).  `epcontact.studies.rim` measures the constants and
`epcontact.studies.areas` those of the errors.
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
#: Cells missed for each tip by straight gaps (`rim.calibrate_straight_tip`).
TIP = 0.277
#: The mean offset on oblong cells is 1 + OBLONG ln^2(dx/dy) times that on square ones; needed by
#: test_oblong_cells.
OBLONG = 0.057
#: Variance of an area in square cells for each spacing of its front, of narrow strips along it, for
#: each tip, and for each spacing of edges.  The first is that of the smallest round gaps; the
#: others are fitted to the ensemble of `studies.areas`.
CHANCE = np.array([0.0006, 0.035, 0.78, 0.7])
#: Standard deviation in cells of the errors common to a front, for each spacing of it, of it along
#: the grid, of edges along the grid, and for each cell that may be hidden at edges.  The third is
#: that of two edges with equally likely places, and the last covers worn plateaus; the others are
#: fitted to the ensemble.
COMMON = np.array([0.003, 0.017, 0.2, 3.5])
#: The claimed error in standard deviations; `epcontact chart areas` shows what it covers.
SURE = 2.5
#: Standard deviation of the mean pressure in narrow elastic strips, in units of the hardness, and
#: the correlation of the errors of its two fronts, both on the ensemble of `studies.areas`.
PHI, SHARED = 0.06, 0.9
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
        counted, edges, sure = (np.array(pair) / n for pair in lengths)
        return _areas(*counted), *_possible(edges, np.diag((sure / SURE) ** 2), share)
    stiffness = [STIFFNESS * effective_modulus / step for step in spacing]
    sums = np.zeros(grid.SUMS)
    grid.sweep(pressure, gap, hardness, (stiffness[0], stiffness[1]), OFFSETS, sums)
    contact, plastic, _, _ = count(pressure, hardness)
    oblong = OBLONG * math.log(spacing[0] / spacing[1]) ** 2
    located = np.array([corrected(sums, front, oblong) for front in range(2)]) / n
    errors = np.array([_uncertainty(sums, front, oblong) for front in range(2)]) / n
    if math.isinf(hardness):
        errors[1] = 0.0
    raw = _areas(contact / n, plastic / n)
    moved, covariance = _balanced(located, errors, SHARED * _narrow(sums), raw, share, 1 / n)
    return raw, *_possible(moved, covariance, share)


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


def _possible(areas: FloatArray, covariance: FloatArray, share: float) -> tuple[Areas, Areas]:
    """Move the total and plastic area to the nearest values that carry the load, and their errors.

    A plastic area above share = p0/hardness carries too much, and a contact below it too little.
    The distance moved adds to the error: if nothing of a contact is resolved, the estimate is worth
    no more than the bound.
    """
    moved = np.clip(areas, (share, 0.0), (1.0, share))
    far = np.abs(moved - areas)
    total, plastic = SURE * np.sqrt(np.diag(covariance)) + far
    elastic = SURE * math.sqrt(max(covariance.sum() - 4 * covariance[0, 1], 0.0)) + far.sum()
    error = Areas(total=float(total), elastic=float(elastic), plastic=float(plastic))
    return _areas(*moved), error


def _areas(total: float, plastic: float) -> Areas:
    return Areas(total=float(total), elastic=float(total - plastic), plastic=float(plastic))


def corrected(sums: FloatArray, front: int, oblong: float) -> float:
    """The corrected area of the contact (front 0) or of the plastic part (front 1), in cells.

    sums: of `grid.sweep`; oblong: OBLONG ln^2(dx/dy).
    """
    offset = (1 + oblong) * sums[grid.OFFSET + front] + HARMONIC * sums[grid.HARMONIC + front]
    outward = offset + TIP * sums[grid.TIPS + front]
    side = -1 if front == 0 else 1
    return float(sums[grid.AREA + front] + side * outward + CORNER * sums[grid.TURN + front])


def _narrow(sums: FloatArray) -> float:
    """The share of the fronts that belongs to narrow strips."""
    length = sums[grid.LENGTH] + sums[grid.LENGTH + 1]
    return float((sums[grid.STRIP] + sums[grid.STRIP + 1]) / length) if length else 0.0


def _balanced(
    areas: FloatArray, errors: FloatArray, shared: float, raw: Areas, share: float, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Total and plastic area and their covariance (2, 2), with the load as one more measurement.

    shared: the correlation of the errors of both fronts; share: p0/hardness.

    The elastic area carries the share phi of its hardness, share = A_pl + phi (A - A_pl).  The
    counted points have this exactly with phi of their own.  That phi is as wrong as the counts: a
    surplus of points next to both rims has phi = 1/2.  It is exact for narrow strips of elastic
    contact between apart and plastic, whose pressure rises antisymmetrically, and worth little for
    wide elastic contacts.
    """
    both = shared * errors[0] * errors[1]
    covariance = np.array([[errors[0] ** 2, both], [both, errors[1] ** 2]])
    if raw.elastic <= 0 or raw.plastic <= 0:
        return areas, covariance
    phi = (share - raw.plastic) / raw.elastic
    slopes = np.array([phi, 1 - phi])
    doubt = PHI * max(areas[0] - areas[1], cell)
    gain = covariance @ slopes
    gain /= slopes @ gain + doubt * doubt
    moved = areas + gain * (share - slopes @ areas)
    return moved, covariance - np.outer(gain, slopes @ covariance)


def _uncertainty(sums: FloatArray, front: int, oblong: float) -> float:
    """Standard deviation in cells of the area that a front encloses.

    Random errors grow as the square root of a front's length; they are the widths of strips, tips
    found by chance, the places of edges in their cells, and the dips, which are bounds.  Errors
    common to a whole front grow as its length; they are those of its offset, which changes where a
    front runs in one direction, of edges along the grid, which meet their cells alike, and of zones
    hidden at edges.  A few links of a smooth surface look like edges, so that these count in
    proportion to the share of edges in the other front.
    """
    pinned, other = sums[grid.PINNED + front], 1 - front
    length, strip, tips = (sums[k + front] for k in (grid.LENGTH, grid.STRIP, grid.TIPS))
    chance = CHANCE @ np.array([length, strip, tips, pinned])
    edges = sums[grid.PINNED + other] / max(sums[grid.LENGTH + other], 1.0)
    common = COMMON * np.array(
        [
            length,
            sums[grid.HARMONIC + front],
            sums[grid.ALIGNED + front],
            edges * sums[grid.BEYOND + other],
        ]
    )
    hidden = math.sqrt(sums[grid.DIPS + front]) / SURE
    return math.hypot(math.sqrt(chance), *common, hidden, oblong * sums[grid.OFFSET + front])
