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

import numpy as np
from numpy.typing import NDArray

from epcontact.bem import area_sweep as sweep
from epcontact.bem.area_line import AXIS_OFFSET, line_lengths
from epcontact.errors import InvalidScene
from epcontact.results import Areas

FloatArray = NDArray[np.float64]

#: Yastrebov, Anciaux and Molinari (2017): of a grid cell's area, for each switch.
PERIMETER_FACTOR = (math.pi - 1 + math.log(2)) / 24
#: Fitted to rough surfaces at 4 points per shortest wavelength; vanishes on finer grids by itself.
STRIP_CURVATURE = 0.25
#: Of the hardness; what is closer to it than rounding is plastic.
_ROUNDING = 1 - 1e-12


def perimeter_areas(pressure: FloatArray, hardness: float = math.inf) -> tuple[Areas, Areas]:
    """(raw, corrected) areas by the published perimeter correction.

    pressure: (nx, ny) or (nx,), in Pa, zero where apart and `hardness` (Pa) where plastic.  On a
    line, for which nothing is published, the exact offset AXIS_OFFSET stands in.
    """
    grid, hardness = pressure.reshape(pressure.shape[0], -1), hardness * _ROUNDING
    contact, plastic, contact_switches, plastic_switches = sweep.count(grid, hardness)
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
    share = float(pressure.mean()) / hardness
    hardness, n = hardness * _ROUNDING, pressure.size
    if pressure.ndim == 1:
        lengths = line_lengths(pressure, gap, hardness, effective_modulus / spacing[0])
        counted, located, error = ((total / n, plastic / n) for total, plastic in lengths)
        return _areas(*counted), *_possible(located, error, share)
    stiffness = effective_modulus / math.sqrt(spacing[0] * spacing[1])
    sums = np.zeros(10)
    sweep.sweep(pressure, gap, hardness, stiffness, sums)
    sweep.sweep(pressure.T, gap.T, hardness, stiffness, sums)
    contact, plastic, _, _ = sweep.count(pressure, hardness)
    correction = _correction(sums, 0)
    plastic_correction = _correction(sums, 1)
    corrected = ((contact - correction) / n, (plastic + plastic_correction) / n)
    uncertain = (
        _uncertainty(sums, 0, correction, min(contact, n - contact)),
        _uncertainty(sums, 1, plastic_correction, min(plastic, n - plastic)),
    )
    errors = (uncertain[0] / n, uncertain[1] / n)
    return _areas(contact / n, plastic / n), *_possible(corrected, errors, share)


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


def _correction(sums: FloatArray, front: int) -> float:
    """Cells to take off the contact (front 0), or to add to the plastic part (front 1)."""
    rim, line = sums[sweep.RIM + front], sums[sweep.LINE + front]
    switches = rim + sums[sweep.STRIP]
    if switches == 0:
        return 0.0
    share = rim / switches
    longest = AXIS_OFFSET - sweep.RIM_PER_SWITCH
    excess = max(0.0, line - sweep.ISOTROPIC_EXCESS * switches) * share
    straight = excess * longest / (longest - sweep.ISOTROPIC_EXCESS)
    strips = sums[sweep.STRIP_OFFSET] * (1 + (-1) ** front * _curved_strips(sums))
    offset = sweep.RIM_PER_SWITCH * rim + strips + straight
    return float(offset - sums[sweep.LOCATED + front])


def _curved_strips(sums: FloatArray) -> float:
    """Share of a strip's offset that moves from its inner front to its outer one.

    A strip around a plastic spot is longer outside than inside, and the tables are for straight
    ones.  Odd under particle-hole exchange; STRIP_CURVATURE is a fit.
    """
    outer = sums[sweep.RIM] + sums[sweep.STRIP]
    inner = sums[sweep.PLASTIC_RIM] + sums[sweep.STRIP]
    both = outer + inner
    return float(STRIP_CURVATURE * (outer - inner) / both * 2 * sums[sweep.STRIP] / both)


def _uncertainty(sums: FloatArray, front: int, correction: float, area: float) -> float:
    """Cells by which an area may be off; the figures are measured, see the tests.

    The rim's position in its cells is random, over a straight rim all at once; a next order falls
    with the size of the spots.
    """
    switches = sums[sweep.RIM + front] + sums[sweep.STRIP]
    chance = math.sqrt(0.16 * switches + 0.25 * sums[sweep.LINE_SQUARES + front])
    order = 0.5 * correction * min(1.0, correction / max(area, 1.0))
    return math.hypot(chance, order, 0.05 * sums[sweep.STRIP_OFFSET])
