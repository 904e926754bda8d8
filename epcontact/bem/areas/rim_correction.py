"""The rim correction: contact areas in the limit of a vanishing grid spacing, from one
solution.

Counting grid points overestimates a contact by its rim, and underestimates its plastic
part, the mirror image.  In cells, with lengths in spacings, the contact is

    A = A_located + CORNER * (Euler number)
        - (integral of offset(u) (1 + HARMONIC cos 4 theta) along the front) - TIP *
          (tips)
        - (zones that the plastic front tells, and creases, that show no point)

and its plastic part has the terms of the last two lines added, with zones that the
front of the contact tells.  The offset is that of the discrete problem at a straight
front of direction theta with an elastic strip of width u beside it, and none where a
step of the surface holds the front. CORNER is what a front lacks by its curvature,
which integrates to the Euler number; tips, zones and creases are narrower than a
spacing.  On oblong cells the offset is larger (OBLONG).  The load is one more
measurement, errors follow from the same sums, and `laboratory` measures constants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from epcontact.bem.areas.front import ANYWHERE, AXIS_OFFSET, STIFFNESS
from epcontact.bem.areas.grid import (
    ALIKE,
    CORNER,
    NARROW,
    OFFSETS,
    Solution,
    Sums,
    sweep,
)
from epcontact.bem.workers import Workers, ranges
from epcontact.errors import InvalidScene
from epcontact.results import Areas, FloatArray
from epcontact.scene import LARGEST, array, as_tuple, integer, positive

#: By what share of it the offset changes with a front's direction
#: (`rim.calibrate_directions`).
HARMONIC = 0.0711
#: Cells that a gap lacks at each tip thinner than a spacing, which is round as half a
#: spot is.
TIP = CORNER / 2
#: On oblong cells the mean offset grows by OBLONG ln^2(dx/dy) of itself
#: (`rim.calibrate_oblong`).
OBLONG = 0.07
#: Mean offset of a counted front, in spacings (`rim.front_offset`), and the variance of
#: the points inside for a spacing of it (Kendall, Q. J. Math. 19 (1948) 1).
COUNTED, POINTS = 0.129, 0.0728
#: Systematic error of OFFSETS for each spacing of the shorter front (the paper's
#: surface, 4096^2).
STRIPS = 0.001
#: The claimed error in standard deviations: nine out of ten normal errors are smaller.
SURE = 1.645
_ROUNDING = 1 - 1e-12  # a pressure above this share of the hardness is plastic
_ROWS, _COLUMNS = 64, 1024  # swept at a time


def estimate_areas(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: Sequence[float],
    effective_modulus: float,
    threads: int = 1,
    flowed: FloatArray | None = None,
) -> tuple[Areas, Areas, Areas]:
    """(raw, corrected, error) areas as fractions of the nominal area, from one
    converged solution.

    pressure, gap: (nx, ny) or (nx,), in Pa and m, the gap positive where apart, and
    minus all flow where plastic; hardness: in Pa, may be infinite; spacing: (dx, dy) or
    (dx,), in m; effective_modulus: E* in Pa, also for a layer, because short waves
    determine a rim; threads: any number gives the same bits; flowed: what earlier flow
    has lowered the surface by, in m, where a load is no longer the largest; the gap is
    then that to the lowered surface, and the plastic area 0 unless points flow again.
    The error is meant to cover nine of ten errors of corrected areas.
    """
    pressure, gap, spacing = (
        array("pressure", pressure),
        array("gap", gap),
        as_tuple(spacing),
    )
    flowed = None if flowed is None else array("flowed", flowed)
    given = {"pressure": pressure, "gap": gap} | (
        {} if flowed is None else {"flowed": flowed}
    )
    shapes = {values.shape for values in given.values()}
    if len(shapes) > 1 or len(spacing) != pressure.ndim or pressure.ndim not in (1, 2):
        raise InvalidScene(
            f"arrays of {sorted(shapes)} points and {len(spacing)} spacings do not fit: "
            "a line (nx,) or a grid (nx, ny) each and one spacing a direction are needed"
        )
    hardness = positive("hardness", hardness, "Pa", finite=False)
    spacing = [positive("spacing", distance, "m") for distance in spacing]
    effective_modulus = positive("effective_modulus", effective_modulus, "Pa")
    threads = integer("threads", threads, 1)
    for name, values in given.items():
        least, most = (
            (values.min(), values.max()) if values.size else (math.nan, math.nan)
        )
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
    summed = sums_of_fronts(
        pressure, gap, hardness, spacing, effective_modulus, threads, flowed
    )
    total, plastic = (summed[0].points / summed[2]).tolist()
    return Areas(total, total - plastic, plastic), *areas_of_sums(*summed)


def sums_of_fronts(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    spacing: Sequence[float],
    effective_modulus: float,
    threads: int = 1,
    flowed: FloatArray | None = None,
) -> tuple[Sums, float, float, float]:
    """Arguments of `areas_of_sums` for a solution on a grid; arguments as of
    `estimate_areas`.
    """
    if pressure.ndim == 1:  # a grid of one column, whose fronts are all straight
        pressure, gap, spacing = (
            pressure[:, None],
            gap[:, None],
            [spacing[0], spacing[0]],
        )
    (nx, ny), (dx, dy), c = pressure.shape, spacing, STIFFNESS * effective_modulus
    # The exact offset of fronts along one axis, as those of a line are.
    offsets = (
        OFFSETS * (AXIS_OFFSET / (1 + HARMONIC) / OFFSETS[-1]) if ny == 1 else OFFSETS
    )
    earlier = (np.zeros((0, 0)), hardness * _ROUNDING)
    if flowed is not None:
        earlier = (
            (flowed.reshape(nx, ny), hardness) if math.isfinite(hardness) else earlier
        )
        hardness = hardness if pressure.max() >= hardness * _ROUNDING else math.inf
    solution = Solution(pressure, gap, hardness * _ROUNDING, (c / dx, c / dy), *earlier)
    rows, columns = ranges(nx, _ROWS), ranges(ny, _COLUMNS)
    blocks = np.array(
        [(r.start, r.stop, k.start, k.stop) for k in columns for r in rows]
    )
    shares = np.array_split(blocks, min(len(blocks), 4 * threads if threads > 1 else 1))
    with Workers(threads) as workers:
        parts = workers.each(sweep, solution, shares, offsets)
    times, each = copies(pressure), np.concatenate(parts)
    sums = Sums(
        *(each.view(float).reshape(-1, 2, len(Sums._fields)).sum(axis=0) / times).T
    )
    return sums, float(pressure.mean()) / earlier[1], pressure.size / times, dx / dy


def areas_of_sums(
    sums: Sums, share: float, cells: float, aspect: float
) -> tuple[Areas, Areas]:
    """(corrected, error) from the sums over the cells of one of the `copies`, which err
    alike. share: p0/hardness; aspect: dx/dy.
    """
    oblong = OBLONG * math.log(aspect) ** 2
    located, covariance = located_areas(sums, oblong), _covariance(sums, oblong)
    if sums.points[0] > sums.points[1] > 0:
        located, covariance = _balanced(located, covariance, sums, share * cells)
    # What no point shows, the load does not tell: zones, squares (claims), creases, a
    # lone point.
    located = located + (-1, 1) * (sums.zone[::-1] + sums.crease)
    unseen = (sums.zone[::-1] ** 2 + sums.squares) / SURE**2 + (
        TIP / 2 * sums.tips
    ) ** 2
    unseen += sums.crease**2 + (located * (sums.points == 1) * (cells > 1)) ** 2
    return _possible(located / cells, (covariance + np.diag(unseen)) / cells**2, share)


def _possible(
    areas: FloatArray, covariance: FloatArray, share: float
) -> tuple[Areas, Areas]:
    """Move the areas to the nearest ones that carry the load, share = p0/hardness.  The
    distance adds to their errors, which are at most those to the farther bound.
    """
    low, high = np.array([share, 0.0]), np.array([1.0, share])
    moved = np.clip(areas, low, high)
    far = np.abs(moved - areas)
    claims = SURE * np.sqrt(np.diag(covariance)) + far
    total, plastic = np.minimum(claims, np.maximum(moved - low, high - moved))
    variance, elastic = np.trace(covariance) - 2 * covariance[0, 1], moved[0] - moved[1]
    claim = min(
        SURE * math.sqrt(max(variance, 0.0)) + far.sum(), max(elastic, 1 - elastic)
    )
    corrected = Areas(float(moved[0]), float(elastic), float(moved[1]))
    return corrected, Areas(float(total), float(claim), float(plastic))


def located_areas(sums: Sums, oblong: float) -> FloatArray:
    """(2,) areas in cells of the contact and its plastic part; oblong: OBLONG
    ln^2(dx/dy).
    """
    outward = (1 + oblong) * sums.offset + HARMONIC * sums.harmonic + TIP * sums.tips
    return np.asarray(sums.area + (-1, 1) * outward + CORNER * sums.turn)


def _covariance(sums: Sums, oblong: float) -> FloatArray:
    """Covariance (2, 2) of the two areas in square cells, but for tips and what no
    point shows.

    Errors by chance grow as the square root of a front's length, errors in common as
    the length: of its doubt 5/4 of the share of one direction or, if more, a tenth,
    ANYWHERE/3 at edges, kinks. What a spot lacks by its curvature is known to a sixth,
    and to a twelfth in common (.53 to .65 on radii of 1.5 to 12), a release and OBLONG
    to a quarter, the change with direction to 2/5.
    """
    aligned = np.hypot(sums.harmonic, sums.sine) / np.maximum(sums.offset, 1e-9)
    chance = (
        sums.chance + ANYWHERE**2 * sums.held + (CORNER / 6) ** 2 * np.abs(sums.turn)
    )
    common = (ANYWHERE / 3) ** 2 * (sums.held**2 + sums.kinked**2) + (
        CORNER / 12 * sums.turn
    ) ** 2
    common += (np.maximum(1.25 * aligned, 0.1) * sums.doubt) ** 2 + (
        sums.released / 4
    ) ** 2
    common += (0.4 * HARMONIC * sums.harmonic) ** 2 + (oblong / 4 * sums.offset) ** 2
    common += (STRIPS * (sums.length + sums.shared).min()) ** 2
    strips = NARROW**2 * sums.shared.mean()  # move both fronts, where points show both
    return np.asarray(
        np.diag(chance + common) + (strips if sums.points[1] else np.eye(2) * strips)
    )


def _balanced(
    areas: FloatArray, covariance: FloatArray, sums: Sums, load: float
) -> tuple[FloatArray, FloatArray]:
    """Total and plastic area and their covariance (2, 2), with the load as one more
    measurement.

    All in cells, the load by the hardness: load = A_pl + phi (A - A_pl), with phi of
    the points. It is right in strips, where the pressure rises antisymmetrically.
    Other fronts count COUNTED too much a spacing, by chance of POINTS, but anything at
    edges and kinks, and TIP for each tip. If areas and load differ by more than their
    errors explain, these grow until they do (Birge, Phys. Rev. 40 (1932) 207).
    """
    contact, plastic = sums.points
    phi = (load - plastic) / (contact - plastic)
    slopes = np.maximum(
        [phi, 1 - phi], 1e-9
    )  # elastic points may carry nothing but rounding
    carried = load - (slopes * (1, -1)) @ (
        COUNTED * (sums.length - sums.held) + TIP * sums.tips
    )
    doubt = POINTS * sums.length + ANYWHERE**2 * (sums.held**2 + sums.kinked**2)
    common, off = covariance @ slopes, carried - slopes @ areas
    variance = slopes @ common + slopes**2 @ doubt
    left = covariance - np.outer(common, common) / variance
    return areas + common * (off / variance), left * max(1.0, off**2 / variance - 1)


def copies(pressure: FloatArray) -> int:
    """Count how often a periodic grid (nx, ny) repeats its shortest period, in whole
    points.
    """
    count, peak = 1, np.unravel_index(pressure.argmax(), pressure.shape)
    close = ALIKE * float(pressure[peak] - pressure.min())
    for rows, (first, at) in ((pressure, peak), (pressure.T, peak[::-1])):
        n, line = len(rows), abs(rows[:, at] - rows[first, at]) <= close
        for step in [k for k in range(1, n // 2 + 1) if n % k == 0 and line[first - k]]:
            both = {
                step,
                n // step // 2 * step,
            }  # what hardly changes in one does in half of all
            pairs = ((i % n, way) for i in range(first, first + n) for way in both)
            if all(np.abs(rows[i] - rows[i - way]).max() <= close for i, way in pairs):
                count *= n // step
                break
    return count
