"""The discrete problem at a straight front: where the area estimates have their constants from.

One front.  A Wiener-Hopf factorisation on the half-line of rows (`area_rows`) solves it: fronts of
every position are reached by the pressures (1/S_+) (alpha n + beta), 0 <= beta <= alpha, and far
inside these are the continuum's K sqrt(s) with the front shifted by
    delta(n)/dx = -(1/pi) int_0^inf ln(|fold(t n)|/t) dt/t^2
behind the edge of the counted cells, averaged over positions: 0.190 along the grid's axes, 0.134
along the diagonals.  A located front, as `area_sweep` has it, is 0.190 dx off along the axes
at any position, and 0.164 along the diagonals.

Two fronts.  Where apart and plastic lie close to each other, an elastic strip of width w between
them, the offset vanishes with w, overshoots and settles at a spacing's width.  Solutions over all
w, directions and positions give it by u = hardness/|grad v|, which a cell can see.

Gaps that are narrower than a spacing come as Westergaard's near full contact: what they lack for
each tip that they show, were every width equally likely, is STRAIGHT_TIP.

`python -m epcontact.studies.rim` prints the tables, in some ten seconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from epcontact.bem import Options, solve_pressure
from epcontact.bem.areas import surface as sweep
from epcontact.bem.areas.estimate import CORNER, HARMONIC, OFFSETS, TIP, corrected
from epcontact.bem.areas.front import AXIS_OFFSET, STIFFNESS
from epcontact.bem.kernel import rfft_wavenumbers
from epcontact.reference import bumps
from epcontact.reference.waves import line_contact_fraction
from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.rim_rows import book_rows, front_offset, row_period, solve_rows, solve_wave
from epcontact.surfaces import SelfAffine

#: Lattice directions of the fronts, spread over the eighth of the circle that symmetry leaves.
DIRECTIONS = ((1, 0), (23, 1), (17, 3), (15, 4), (13, 5), (11, 7), (13, 9), (11, 9), (1, 1))
#: Period of the waviness in grid spacings, and hardness in units of E* h/dx: widths 0 to 4 dx.
PERIOD = 40
HARDNESSES = (
    *(0.003, 0.006, 0.01, 0.014, 0.018, 0.022, 0.026, 0.03, 0.034, 0.037, 0.04, 0.043, 0.046),
    *(0.05, 0.053, 0.056, 0.06, 0.063, 0.066, 0.07, 0.074, 0.078, 0.083, 0.09, 0.095),
)
#: Loads and hardnesses, in units of E* times the rms slope, of the rough surfaces.
ROUGH = ((0.05, 0.6), (0.05, math.inf), (0.2, 0.6), (0.1, 1.2), (0.4, 0.6))
#: Weight of the second differences of the table.
SMOOTHING = 0.003


def exact_fronts(hardness: float, period: float, points: int = 1 << 16) -> tuple[float, float]:
    """Half-widths of contact and of the plastic part (dx) of one wave, on a very fine line."""
    spacing = period / points
    q = 2 * np.pi * np.arange(points // 2 + 1) / period
    q[0] = np.inf
    p, g = solve_wave(2 / q, points, 0.3, hardness / 2, hardness)
    field = p - STIFFNESS / spacing * g
    contact = _length(field) / 2 * spacing
    plastic = (points - _length(hardness - field)) / 2 * spacing
    return (contact, plastic) if contact > plastic else (period / 4, period / 4)


def _length(field: FloatArray) -> float:
    """Length (in points) where a line's p - c g is positive, its crossings interpolated."""
    after = np.roll(field, -1)
    crossing = (field > 0) != (after > 0)
    high, low = np.maximum(field, after)[crossing], np.minimum(field, after)[crossing]
    both = np.count_nonzero((field > 0) & (after > 0))
    inside = float(np.sum(high / (high - low)))
    return float(both + inside - np.count_nonzero(crossing) * AXIS_OFFSET)


#: (lattice direction, weight of each phase, phases)
Fronts = list[tuple[tuple[int, int], float, list[float]]]


def along_axis(count: int = 60) -> Fronts:
    """Fronts along the grid only, as on a line."""
    return [((1, 0), 1 / count, [(k + 0.5) / count for k in range(count)])]


def all_directions(along: int = 40, across: int = 2) -> Fronts:
    """Fronts of all directions: rows of a lattice line need many phases, others have them."""
    angles = np.array([math.atan2(b, a) for a, b in DIRECTIONS])
    weights = np.diff(np.r_[angles[0], (angles[1:] + angles[:-1]) / 2, angles[-1]])
    weights /= weights.sum()
    out = []
    for direction, weight in zip(DIRECTIONS, weights, strict=True):
        count = along if max(direction) == 1 else across
        phases = [(k + 0.5) / count for k in range(count)]
        out.append((direction, float(weight) / count, phases))
    return out


def calibrate_directions() -> tuple[float, float]:
    """(mean, amplitude of cos 4 theta) of the offset of one front, in dx."""
    load = 0.5
    exact = line_contact_fraction(load) / 2
    offsets = []
    for direction, _, phases in all_directions(40, 1):
        period = row_period(direction, PERIOD)[1]
        rows = [solve_rows(direction, PERIOD, s, load * math.pi / period) for s in phases]
        sums = np.mean([book_rows(r)[0] for r in rows], axis=0)
        offsets.append((sums[sweep.AREA] - exact * period) / sums[sweep.LENGTH])
    waves = np.array([math.cos(4 * math.atan2(b, a)) for a, b in DIRECTIONS])
    amplitude, mean = np.polyfit(waves, offsets, 1)
    return float(mean), float(amplitude)


def calibrate_strips(fronts: Fronts) -> tuple[FloatArray, float]:
    """(offsets at U_NODES, largest misfit), in dx, of a front with another one beside it.

    Least squares over the widths of the strip, each the mean over directions and positions.
    """
    features, biases = [], []
    for hardness in HARDNESSES:
        contact, plastic = exact_fronts(hardness, PERIOD)
        feature, bias = np.zeros(len(sweep.U_NODES)), 0.0
        for direction, weight, phases in fronts:
            scale = row_period(direction, PERIOD)[1] / PERIOD
            for phase in phases:
                cap = hardness / scale
                sums, nodes = book_rows(solve_rows(direction, PERIOD, phase, cap / 2, cap))
                feature += weight * nodes.mean(axis=1)
                outer = sums[sweep.AREA] - contact * scale
                inner = sums[sweep.AREA + 1] - plastic * scale
                bias += weight * (outer - inner) / 2
        features.append(feature)
        biases.append(bias)
    table = _fit(np.array(features), np.array(biases))
    return table, float(np.abs(np.array(features) @ table - biases).max())


def _fit(features: FloatArray, biases: FloatArray) -> FloatArray:
    """Table with small second differences, 0 where a strip has no width."""
    nodes = sweep.U_NODES
    smooth = np.zeros((len(nodes) - 1, len(nodes)))
    for i in range(1, len(nodes) - 1):
        left, right = nodes[i] - nodes[i - 1], nodes[i + 1] - nodes[i]
        smooth[i - 1, i - 1 : i + 2] = 1 / left, -1 / left - 1 / right, 1 / right
    smooth *= SMOOTHING
    smooth[-1, 0] = 100
    target = np.r_[biases, np.zeros(len(smooth))]
    return np.asarray(np.linalg.lstsq(np.r_[features, smooth], target, rcond=None)[0])


def calibrate_straight_tip(
    fronts: Fronts, offset: float, harmonic: float, step: float = 0.1
) -> float:
    """Cells that a straight gap lacks for each tip, over widths of 0 to 2.2 dx alike.

    offset, harmonic: of a located front, in dx.
    """
    lacking = tips = 0.0
    for width in np.arange(step / 2, 2.2, step):
        for direction, weight, phases in fronts:
            period = row_period(direction, 24)[1]
            share = 1 - width / period
            load = math.pi / period * math.sin(math.pi / 2 * share) ** 2
            for phase in phases:
                sums, _ = book_rows(solve_rows(direction, 24, phase, load))
                outward = offset * sums[sweep.LENGTH] + harmonic * sums[sweep.HARMONIC]
                lacking += weight * (sums[sweep.AREA] - outward - share * period / 2)
                tips += weight * sums[sweep.TIPS]
    return lacking / tips


def calibrate_corner(radius: float = 5.0, shifts: int = 24) -> tuple[float, float]:
    """(cells that a spot lacks by its curvature, standard error), on spheres, exact by Hertz."""
    n = 2 * round(radius / 0.3)
    force = bumps.sphere_force(radius / n, 1.0, 1.0)
    exact = math.pi * bumps.sphere_contact_radius_periodic(force, 1.0, 1.0, 1.0) ** 2 * n * n
    q = rfft_wavenumbers((n, n), (1.0, 1.0))
    q[0, 0] = np.inf
    out = []
    for shift in np.random.default_rng(1).uniform(size=(shifts, 2)):
        x, y = ((np.arange(n) + s) / n - 0.5 for s in shift)
        h = -(x[:, None] ** 2 + y**2) / 2
        solution = solve_pressure(h, 2 / q, force, options=Options(tolerance=1e-7))
        gap = solution.displacement + solution.offset - h
        sums = np.zeros(sweep.SUMS)
        c = STIFFNESS * n
        sweep.sweep(solution.pressure, gap, math.inf, (c, c), OFFSETS, sums)
        offset = sums[sweep.OFFSET] + HARMONIC * sums[sweep.HARMONIC]
        out.append((exact - sums[sweep.AREA] + offset) / sums[sweep.TURN])
    return float(np.mean(out)), float(np.std(out) / math.sqrt(shifts))


def calibrate_rough_tip(seeds: Sequence[int] = range(2000, 2004), high: int = 32) -> float:
    """Cells that a tip stands for on rough surfaces at four points to their shortest wave.

    Least squares over the areas against grids of 24 points, each relative to its area; hurst
    0.8, roll-off at twice the period, `high` shortest waves a period.
    """
    products = squares = 0.0
    spectrum = SelfAffineSpectrum(0.8, 2 * np.pi, 4 * np.pi, 2 * np.pi * high, 1.0)
    for seed, (load, hardness) in itertools.product(seeds, ROUGH):
        found = []
        for points in (24, 4):
            n = points * high
            heights = SelfAffine(spectrum, (1.0, 1.0), (n, n), seed).build().heights
            q = rfft_wavenumbers((n, n), (1.0, 1.0))
            q[0, 0] = np.inf
            options = Options(tolerance=1e-7)
            solution = solve_pressure(heights, 2 / q, load, hardness, options=options)
            gap, c = solution.displacement + solution.offset - heights, STIFFNESS * n
            sums, cap = np.zeros(sweep.SUMS), hardness * (1 - 1e-12)
            sweep.sweep(solution.pressure, gap, cap, (c, c), OFFSETS, sums)
            found.append(sums / n**2)
        fronts = 1 if math.isinf(hardness) else 2
        areas = np.array([[corrected(sums, k, 0.0) for k in range(fronts)] for sums in found])
        tips = found[1][sweep.TIPS : sweep.TIPS + fronts] * np.array([1, -1])[:fronts]
        if fronts == 2:  # and the elastic area
            areas, tips = np.c_[areas, areas[:, 0] - areas[:, 1]], np.r_[tips, tips[0] - tips[1]]
        # `corrected` has taken TIP for each already.
        products += float(np.sum((areas[1] - areas[0] + TIP * tips) * tips / areas[0]))
        squares += float(np.sum(tips**2 / areas[0]))
    return products / squares


def main() -> None:
    """Print the constants and tables of `area` and `area_line`."""
    print("offset of a counted front along an axis", round(front_offset(0.0), 5))
    mean, amplitude = calibrate_directions()
    print("offset of a located front", round(mean, 4), "+", round(amplitude, 4), "cos 4 theta")
    print("u     ", sweep.U_NODES)
    for name, fronts in (("offset", all_directions()), ("line", along_axis())):
        table, misfit = calibrate_strips(fronts)
        print(name, np.round(table, 4), " largest misfit", round(misfit, 4))
    print("corner", "{:.3f} +- {:.3f}".format(*calibrate_corner()), "in use", CORNER)
    tip = calibrate_straight_tip(all_directions(), float(OFFSETS[-1]), HARMONIC)
    print("straight tip", round(tip, 3))
    print("tip of rough surfaces", round(calibrate_rough_tip(), 3), "in use", TIP)
    print("lone point", round(calibrate_straight_tip(along_axis(), AXIS_OFFSET, 0.0), 3))


if __name__ == "__main__":
    main()
