"""The rim correction: contact areas in the limit of a vanishing grid spacing.

Counting grid points overestimates a contact by its rim, and underestimates its plastic
part, the mirror image.  In cells, with lengths in spacings, the contact is

    A = A_located                                 area inside the located front
        + CORNER (Euler number)                   a curved front lacks so much
        - integral of offset(u) (1 + HARMONIC cos 4 theta) along the front
        - TIP (tips)                              gaps narrower than a spacing
        - hidden zones of the plastic front, and creases

and its plastic part has the terms of the last three lines added, with zones hidden at
the front of the contact.  The offset is that of the discrete problem at a straight
front of direction theta with an elastic strip of width u beside it; there is none where
a step of the surface holds the front.  CORNER is what a front lacks by its curvature,
which integrates to the Euler number.  On oblong cells the offset is larger (OBLONG).

The load is one more measurement of the areas (`_balance`), and their errors follow from
the same sums (`_covariance`).  The modules `laboratory.rim` and `laboratory.area_bank`
of the tests measure the constants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from epcontact.bem.areas.front import ANYWHERE, AXIS_OFFSET
from epcontact.bem.areas.grid import (
    ALIKE,
    CORNER,
    NARROW,
    OFFSETS,
    Solution,
    Sums,
    sweep,
)
from epcontact.bem.areas.hidden import STIFFNESS
from epcontact.bem.workers import Workers, ranges
from epcontact.errors import InvalidScene
from epcontact.results import Areas, FloatArray
from epcontact.scene import LARGEST, array, as_tuple, integer, positive

#: Fraction by which the offset changes with a front's direction
#: (`rim.calibrate_directions`).
HARMONIC = 0.0711
#: Cells that a gap lacks at each tip thinner than a spacing, which is round as half a
#: spot is.
TIP = CORNER / 2
#: On oblong cells the mean offset grows by the fraction OBLONG ln^2(dx/dy)
#: (`rim.calibrate_oblong`).
OBLONG = 0.07
#: Mean offset of a counted front, in spacings (`rim.front_offset`).
COUNTED = 0.129
#: Variance of the number of points inside a front, for a spacing of its length
#: (Kendall, Q. J. Math. 19 (1948) 1).
POINTS = 0.0728
#: The error estimate in standard deviations: nine of ten normal errors are smaller.
SURE = 1.645
# The area of a round contact of so many points may be any below the estimated one: four
# points around a summit say no more than one on it.
_AROUND_A_SUMMIT = 4
_ROUNDING = 1 - 1e-12  # a pressure above this fraction of the hardness is plastic
# Rows and columns of a block that is swept at a time.
_ROWS = 64
_COLUMNS = 1024


def estimate_areas(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: Sequence[float],
    effective_modulus: float,
    threads: int = 1,
    flowed: FloatArray | None = None,
) -> tuple[Areas, Areas, Areas]:
    """Estimate the contact areas in the continuum from one converged solution.

    Args:
        pressure: (nx, ny) or (nx,), in Pa, from 0 to the hardness.
        gap: of the same shape, in m; positive where apart, and where plastic minus the
            plastic displacement, that of earlier loads too.
        hardness: in Pa, may be infinite.
        spacing: (dx, dy) or (dx,), in m.
        effective_modulus: E* in Pa, also for a layer, because short waves determine a
            rim.
        threads: number of threads; any number gives the same bits.
        flowed: plastic displacement of earlier loads in m, if the load is below their
            largest one.  The gap is then that to the lowered surface, and the plastic
            area is 0 unless points flow again.

    Returns:
        The areas (raw, corrected, error) as fractions of the nominal area.  The error
        estimate is meant to cover nine of ten errors of corrected areas.

    Raises:
        InvalidScene: an argument is not valid.
    """
    fields = {"pressure": array("pressure", pressure), "gap": array("gap", gap)}
    if flowed is not None:
        fields["flowed"] = array("flowed", flowed)
    shapes = {values.shape for values in fields.values()}
    spacing = as_tuple(spacing)
    dimensions = fields["pressure"].ndim
    if len(shapes) > 1 or len(spacing) != dimensions or dimensions not in (1, 2):
        raise InvalidScene(
            f"arrays of {sorted(shapes)} points and {len(spacing)} spacings do not "
            "fit: a line (nx,) or a grid (nx, ny) each and one spacing a direction are "
            "needed"
        )
    hardness = positive("hardness", hardness, "Pa", finite=False)
    spacing = [positive("spacing", distance, "m") for distance in spacing]
    effective_modulus = positive("effective_modulus", effective_modulus, "Pa")
    threads = integer("threads", threads, 1)
    for name, values in fields.items():
        _require_possible(name, values, hardness)
    sums, load, cells, aspect = sums_of_fronts(
        fields["pressure"],
        fields["gap"],
        hardness,
        spacing,
        effective_modulus,
        threads,
        fields.get("flowed"),
    )
    total, plastic = (sums.points / cells).tolist()
    raw = Areas(total, total - plastic, plastic)
    corrected, error = areas_of_sums(sums, load, cells, aspect)
    return raw, corrected, error


def _require_possible(name: str, values: FloatArray, hardness: float) -> None:
    """Raise InvalidScene if a field has values that no solution has.

    name: "pressure" (Pa), "gap" (m) or "flowed" (m); values: the field; hardness: in
    Pa, above which no pressure may be.  Only a gap may be negative.
    """
    least = most = math.nan
    if values.size:
        least = values.min()
        most = values.max()
    if not max(-least, most) <= LARGEST:
        raise InvalidScene(
            f"{name} is empty or holds NaN or numbers beyond {LARGEST:g}"
        )
    if least < 0 and name != "gap":
        raise InvalidScene(
            f"{name} is negative at a point, but must nowhere be less than 0"
        )
    if name == "pressure" and most * _ROUNDING > hardness:
        raise InvalidScene("a pressure is above the hardness: all are from 0 to it")


def sums_of_fronts(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: Sequence[float],
    effective_modulus: float,
    threads: int = 1,
    flowed: FloatArray | None = None,
) -> tuple[Sums, float, float, float]:
    """Return sums over the fronts of a solution on a grid.

    The arguments are not checked.

    Args:
        pressure: (nx, ny) or (nx,), in Pa.
        gap: of the same shape, in m; where plastic, minus the plastic displacement.
        hardness: in Pa, may be infinite.
        spacing: (dx, dy) or (dx,), in m.
        effective_modulus: E* in Pa.
        threads: number of threads.
        flowed: plastic displacement of earlier, larger loads in m; None: none.

    Returns:
        The arguments of `areas_of_sums`: the sums, the mean pressure over the hardness,
        the number of cells of which they are the sums, and dx/dy.
    """
    if pressure.ndim == 1:  # a grid of one column, whose fronts are all straight
        pressure = pressure[:, None]
        gap = gap[:, None]
        spacing = [spacing[0], spacing[0]]
    nx, ny = pressure.shape
    dx, dy = spacing
    offsets = OFFSETS
    if ny == 1:  # fronts along an axis have this exact offset
        offsets = OFFSETS * (AXIS_OFFSET / (1 + HARMONIC) / OFFSETS[-1])
    stiffness = STIFFNESS * effective_modulus
    load = float(pressure.mean()) / (hardness * _ROUNDING)
    earlier_flow = np.zeros((0, 0))
    earlier_hardness = hardness * _ROUNDING
    if flowed is not None:
        if math.isfinite(hardness):
            load = float(pressure.mean()) / hardness
            earlier_flow = flowed.reshape(nx, ny)
            earlier_hardness = hardness
        if pressure.max() < hardness * _ROUNDING:
            hardness = math.inf  # nothing flows under this load
    solution = Solution(
        pressure,
        gap,
        hardness * _ROUNDING,
        (stiffness / dx, stiffness / dy),
        earlier_flow,
        earlier_hardness,
    )
    blocks = np.array(
        [
            (rows.start, rows.stop, columns.start, columns.stop)
            for columns in ranges(ny, _COLUMNS)
            for rows in ranges(nx, _ROWS)
        ]
    )
    tasks = 4 * threads if threads > 1 else 1
    parts = np.array_split(blocks, min(len(blocks), tasks))
    with Workers(threads) as workers:
        found = np.concatenate(workers.each(sweep, solution, parts, offsets))
    times = copies(pressure)
    by_field = found.view(float).reshape(-1, 2, len(Sums._fields)).sum(axis=0).T
    return Sums(*(by_field / times)), load, pressure.size / times, dx / dy


def areas_of_sums(
    sums: Sums, load: float, cells: float, aspect: float
) -> tuple[Areas, Areas]:
    """Return the corrected areas and their errors, as fractions of the nominal area.

    Args:
        sums: over the fronts.  If the grid holds several copies of a shorter period
            or mirror images, the sums are those of one, because they have equal errors.
        load: mean pressure over hardness.
        cells: number of cells (of one grid point each) of which the sums are.
        aspect: dx/dy.
    """
    oblong = OBLONG * math.log(aspect) ** 2
    areas = located_areas(sums, oblong)
    covariance = _covariance(sums, oblong)
    contact, plastic = sums.points
    if contact > plastic > 0:
        areas, covariance = _balance(areas, covariance, sums, load * cells)
    # The load does not show what no point shows: hidden zones and creases.
    zones = sums.hidden_zone[::-1]  # each front shows zones of the other one
    areas = areas + np.array([-1, 1]) * (zones + sums.crease_area)
    unseen = (zones**2 + sums.gap_squares) / SURE**2 + sums.crease_area**2
    if cells > 1:  # nothing is known of the area of a lone point
        unseen += (areas * (sums.points == 1)) ** 2
    if 1 < contact <= _AROUND_A_SUMMIT and sums.turn[0] > 0:
        unseen[0] += (areas[0] / SURE) ** 2
    return _possible(areas / cells, (covariance + np.diag(unseen)) / cells**2, load)


def _possible(
    areas: FloatArray, covariance: FloatArray, load: float
) -> tuple[Areas, Areas]:
    """Return the areas, moved into the range that can carry the load, and their errors.

    The total area is at least load and at most 1, and the plastic area is from 0 to
    load.  The distance moved is added to the errors.  An error is at most the distance
    to the farther bound.

    areas: (2,) total and plastic area as fractions of the nominal area; covariance:
    (2, 2) of both; load: mean pressure over hardness.
    """
    low = np.array([load, 0.0])
    high = np.array([1.0, load])
    moved = np.clip(areas, low, high)
    distance = np.abs(moved - areas)
    errors = SURE * np.sqrt(np.diag(covariance)) + distance
    errors = np.minimum(errors, np.maximum(moved - low, high - moved))
    elastic = moved[0] - moved[1]
    variance = np.trace(covariance) - 2 * covariance[0, 1]
    error = SURE * math.sqrt(max(variance, 0.0)) + distance.sum()
    error = min(error, max(elastic, 1 - elastic))
    return (
        Areas(float(moved[0]), float(elastic), float(moved[1])),
        Areas(float(errors[0]), float(error), float(errors[1])),
    )


def located_areas(sums: Sums, oblong: float) -> FloatArray:
    """Return the areas (2,) of the contact and of its plastic part, in cells.

    The counted points are corrected by where the fronts were located; the load is not
    used.

    sums: over the fronts; oblong: fraction by which the offset of a front is larger on
    oblong cells.
    """
    outward = (1 + oblong) * sums.offset + HARMONIC * sums.offset_cos + TIP * sums.tips
    return sums.area + np.array([-1, 1]) * outward + CORNER * sums.turn


def _covariance(sums: Sums, oblong: float) -> FloatArray:
    """Return the covariance (2, 2) of contact area and plastic area, in cells squared.

    Gaps and plastic zones between the grid points are not included.

    sums: over the fronts; oblong: fraction by which the offset of a front is larger on
    oblong cells.

    Random errors grow as the square root of a front's length, systematic errors as the
    length.  The systematic error of the positions is their uncertainty times 5/4 of the
    fraction of the front along one direction, or a tenth if this is more; at edges and
    kinks it is ANYWHERE/3.  What a spot lacks by its curvature is known to a sixth for
    each spot, and to a twelfth for all (.53 to .65 on radii of 1.5 to 12 spacings).
    Releases and OBLONG are known to a quarter, the change with direction to 2/5.
    """
    random = sums.scatter + ANYWHERE**2 * sums.pinned
    random += (CORNER / 6) ** 2 * np.abs(sums.turn)
    aligned = np.hypot(sums.offset_cos, sums.offset_sin) / np.maximum(sums.offset, 1e-9)
    systematic = (np.maximum(1.25 * aligned, 0.1) * sums.uncertainty) ** 2
    systematic += (ANYWHERE / 3) ** 2 * (sums.pinned**2 + sums.at_kink**2)
    systematic += (CORNER / 12 * sums.turn) ** 2
    systematic += (sums.released / 4) ** 2
    systematic += (0.4 * HARMONIC * sums.offset_cos) ** 2
    systematic += (oblong / 4 * sums.offset) ** 2
    covariance = np.diag(random + systematic)
    strips = NARROW**2 * sums.shared.mean()
    if sums.points[1]:  # a narrow strip moves both fronts together
        covariance += strips
    else:
        covariance += strips * np.eye(2)
    return np.asarray(covariance)


def _balance(
    areas: FloatArray, covariance: FloatArray, sums: Sums, load: float
) -> tuple[FloatArray, FloatArray]:
    """Return areas and their covariance, improved by the load as one more measurement.

    areas: (2,) contact area and plastic area, in cells; covariance: (2, 2) of both;
    sums: over the fronts; load: sum of the pressures of the cells over the hardness.

    The load is A_pl + phi (A - A_pl), with phi the mean pressure of elastic points over
    the hardness.  This is right in strips, where the pressure rises antisymmetrically.
    Along other fronts the counted contact is too large by COUNTED cells for each
    spacing of the front, with the variance POINTS, and by TIP for each tip; at edges
    and kinks it may be off by anything.  If areas and load differ by more than their
    errors explain, the errors grow until they do (Birge, Phys. Rev. 40 (1932) 207).
    """
    contact, plastic = sums.points
    phi = (load - plastic) / (contact - plastic)
    # Elastic points may carry nothing but rounding.
    slopes = np.maximum([phi, 1 - phi], 1e-9)
    surplus = COUNTED * (sums.length - sums.pinned) + TIP * sums.tips
    measured = load - slopes @ (surplus * np.array([1, -1]))
    variances = POINTS * sums.length
    variances += ANYWHERE**2 * (sums.pinned**2 + sums.at_kink**2)
    gain = covariance @ slopes
    difference = measured - slopes @ areas
    variance = slopes @ gain + slopes**2 @ variances
    remaining = covariance - np.outer(gain, gain) / variance
    birge = max(1.0, difference**2 / variance - 1)
    return areas + gain * (difference / variance), remaining * birge


def copies(pressure: FloatArray) -> int:
    """Return how many copies of its smallest part a periodic field holds.

    Copies are periods of whole points, and mirror images in the middle of the field, as
    a map that was mirrored at its edges has them.

    pressure: (nx, ny).  Two copies may differ at a point by the fraction ALIKE of the
    range of the pressure.
    """
    allowed = ALIKE * float(pressure.max() - pressure.min())
    return _copies_along(pressure, allowed) * _copies_along(pressure.T, allowed)


def _copies_along(rows: FloatArray, allowed: float) -> int:
    """Return how many copies of its smallest part a field holds along its first axis.

    rows: (n, m) of a periodic field; allowed: largest difference at a point.
    """
    peak = int(rows.max(axis=1).argmax())
    periods = 1
    for period in range(1, len(rows) // 2 + 1):
        repeats = len(rows) // period
        # What hardly changes from one row to the next changes in half of them.
        farthest = repeats // 2 * period
        if len(rows) % period == 0 and all(
            _repeats(rows, peak, step, allowed) for step in (period, farthest)
        ):
            periods = repeats
            break
    # Where little changes in one step, the image beside the middle cannot be told.
    hardly_changes = _repeats(rows, peak, 1, allowed)
    if not hardly_changes and _is_mirrored(rows, allowed):
        return 2 * periods
    return periods


def _repeats(rows: FloatArray, first: int, step: int, allowed: float) -> bool:
    """Return True if each row is like the row that is `step` rows before it.

    rows: (n, m) of a periodic field; first: the row that is compared first, which only
    matters for speed; step: number of rows; allowed: largest difference at a point.
    """
    n = len(rows)
    return all(
        np.abs(rows[i % n] - rows[i % n - step]).max() <= allowed
        for i in range(first, first + n)
    )


def _is_mirrored(rows: FloatArray, allowed: float) -> bool:
    """Return True if the first half of the rows is the mirror image of the second one.

    rows: (n, m); allowed: largest difference at a point.
    """
    return all(
        np.abs(rows[i] - rows[-1 - i]).max() <= allowed for i in range(len(rows) // 2)
    )
