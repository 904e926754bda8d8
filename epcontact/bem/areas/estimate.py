"""Contact areas in the limit of a vanishing grid spacing, from one solution on a grid.

Counting grid points overestimates a contact by its rim: the points at which contact is asked for
stand in for the gaps between them.  By particle-hole symmetry (p -> hardness - p, g -> -g) the
count underestimates the plastic part as it overestimates the contact.

`perimeter_areas` is the published remedy (Yastrebov, Anciaux and Molinari, Tribology
International 114 (2017) 161): A = A_raw - (pi - 1 + ln 2)/24 S dx with S the length of the rim,
counted by the switches along rows and columns.  It takes off a sixth too much.

`estimate_areas` locates the fronts inside the cells (`area_sweep`) and corrects what they bound,
in cells, L being a front's length in spacings:

    A = located - sum (offset(u) + HARMONIC cos 4 theta) dL + CORNER chi - TIP (tips)

and the same for the plastic part with the offset and the tips to the other side.

* First order: the offset of a located front is that of the discrete problem at a straight one, of
  any direction theta, with an elastic strip of any width beside it (`rim_calibration`).
* Second order: a smooth front has two local lengths, the radius of its curvature and that over
  which the pressure bends off the square root.  The cubic takes care of the latter; the former
  integrates to the Euler number chi of the front's inside, so that CORNER, measured on a sphere
  (and, of the other sign, on a penny-shaped gap) holds for any shape.
* What is not resolved: gaps (or plastic spots) narrower than a spacing are met by chance.  Met,
  they show as tips; a straight gap that may be of any width calls for STRAIGHT_TIP a tip, a round
  one for nothing.  TIP, in between, is the only figure taken from rough surfaces.

On a line fronts are located inside their cell, see `area_line`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np

from epcontact.bem.areas import surface as sweep
from epcontact.bem.areas.front import AXIS_OFFSET, STIFFNESS
from epcontact.bem.areas.line import line_lengths
from epcontact.errors import InvalidScene
from epcontact.results import Areas, FloatArray

#: Yastrebov, Anciaux and Molinari (2017): of a grid cell's area, for each switch.
PERIMETER_FACTOR = (math.pi - 1 + math.log(2)) / 24
#: Offset of a located front at area_sweep.U_NODES, in spacings, and its share by direction.
OFFSETS = np.array(
    [
        *(0.0, 0.0721, 0.1369, 0.1915, 0.2198, 0.2229, 0.215, 0.1934),
        *(0.18, 0.1743, 0.1695, 0.1784, 0.1778, 0.1788),
    ]
)
HARMONIC = 0.0127
#: Cells that a spot lacks by the curvature of its front.
CORNER = 0.6
#: Cells missed for each tip: of straight gaps, and as fitted to rough surfaces.
STRAIGHT_TIP, TIP = 0.277, 0.24
#: Mean offset on oblong cells, 1 + OBLONG ln^2(dx/dy) times that on square ones.
OBLONG = 0.057
#: Share of narrow strips among the fronts from which on the load places them.
PLACED_FROM = 0.7
#: Of the hardness; what is closer to it than rounding is plastic.
_ROUNDING = 1 - 1e-12


def perimeter_areas(pressure: FloatArray, hardness: float = math.inf) -> tuple[Areas, Areas]:
    """(raw, corrected) areas by the published perimeter correction.

    pressure: (nx, ny) or (nx,), in Pa, zero where apart and `hardness` (Pa) where plastic.  On a
    line, for which nothing is published, the exact offset AXIS_OFFSET stands in.
    """
    grid, hardness = pressure.reshape(pressure.shape[0], -1), hardness * _ROUNDING
    contact, plastic, contact_switches, plastic_switches = count(grid, hardness)
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

    Validity: oblong cells are right on average over directions up to dx/dy = 2; beyond, and for
    fronts of one direction, the error grows.  Works in place, without arrays of the grid's size.

    Raises InvalidScene if the shapes do not fit.
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
    sums = np.zeros(sweep.SUMS)
    sweep.sweep(pressure, gap, hardness, (stiffness[0], stiffness[1]), OFFSETS, sums)
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


def _possible(
    areas: tuple[float, float], errors: tuple[float, float], share: float
) -> tuple[Areas, Areas]:
    """Total and plastic area moved to the nearest that can carry the load, and their errors.

    share = p0/hardness: at the hardness a plastic area larger than that carries too much, and a
    contact smaller than that too little.  What had to be moved adds to the error: where nothing
    of a contact is resolved, the estimate is worth no more than the bound.
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
    """Cells of the contact (front 0) or of the plastic part (front 1)."""
    offset = (1 + oblong) * sums[sweep.OFFSET + front] + HARMONIC * sums[sweep.HARMONIC + front]
    outward = offset + TIP * sums[sweep.TIPS + front]
    side = -1 if front == 0 else 1
    return float(sums[sweep.AREA + front] + side * outward + CORNER * sums[sweep.TURN + front])


def _placed(areas: list[float], sums: FloatArray, share: float) -> tuple[float, float]:
    """Total and plastic area with the middle of the strips where the load puts it.

    Across a narrow strip the pressure rises antisymmetrically, so that strips alone have
    (A + A_pl)/2 = p0/hardness.  Used as far as more than PLACED_FROM of the fronts are strips.
    """
    length = sums[sweep.LENGTH] + sums[sweep.LENGTH + 1]
    strips = (sums[sweep.STRIP] + sums[sweep.STRIP + 1]) / length if length else 0.0
    weight = max(0.0, (strips - PLACED_FROM) / (1 - PLACED_FROM))
    shift = weight * (share - (areas[0] + areas[1]) / 2)
    return areas[0] + shift, areas[1] + shift


def _uncertainty(sums: FloatArray, front: int, area: float, oblong: float) -> float:
    """Cells by which an area may be off; area: cells inside the front or outside, the less.

    Chance: a front's position in its cells, and the tips that happen to be met.  Common to all of
    a front: what its offset, its corners and its tips are known to, a rest of the second order,
    that goes with the distance between fronts, and, where the front runs one way, its offset
    there.  Dips are a bound.  The figures are measured on rough surfaces, see the tests.
    """
    length, strip = sums[sweep.LENGTH + front], sums[sweep.STRIP + front]
    tips, others = sums[sweep.TIPS + front], sums[sweep.TIPS + 1 - front]
    chance = 0.006 * length + 0.08 * strip + 0.5 * tips + sums[sweep.DIPS + front]
    common = (
        0.0015 * length,
        0.003 * strip,
        0.009 * length * length / max(area, 1.0),
        0.1 * tips + 0.04 * others,
        0.05 * sums[sweep.TURN + front],
        oblong * sums[sweep.OFFSET + front],
        0.01 * abs(sums[sweep.HARMONIC + front]),
    )
    return math.hypot(math.sqrt(chance), *common)
