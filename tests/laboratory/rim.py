"""The laboratory of the rim correction: it measures the constants of `bem.areas`.

A straight front with its normal n along the lattice direction (a, b) divides a square
grid into rows of one pressure each, h = dx/sqrt(a^2 + b^2) apart.  Their compliance at
the wave number q is that of the grid at q n folded into its first Brillouin zone, 2/(E*
|fold(q n)|).  So a problem on a line gives the answer for fronts of any direction.

A Wiener-Hopf factorisation on the half-line of rows gives one front: (1/S_+)(alpha n +
beta), 0 <= beta <= alpha.  Far inside, this is the continuum's K sqrt(s) with the front
    delta(n)/dx = -(1/pi) int_0^inf ln(|fold(t n)|/t) dt/t^2
behind the edge of the counted cells, averaged over positions: 0.190 along the grid's
axes, 0.134 along the diagonals.  A front located by `bem.areas.grid` is 0.190 dx off
along the axes at any position, and 0.164 along the diagonals.

If an elastic strip of width w separates apart and plastic points, the offset vanishes
with w, overshoots and settles at a spacing's width.  Solutions over all w, directions
and positions give it as a function of u, the mean of hardness/|grad v| in a cell and of
that one link further inside.

`python -m laboratory.rim` prints the constants and tables, in some ten seconds.
"""

from __future__ import annotations

import itertools
import math
from itertools import pairwise

import numpy as np

from epcontact.bem import Options, solve_pressure
from epcontact.bem.areas import grid
from epcontact.bem.areas.front import (
    AXIS_OFFSET,
    ROWS,
    TOP,
    Links,
    locate,
    locate_special,
)
from epcontact.bem.areas.grid import CORNER, OFFSETS, WIDTHS
from epcontact.bem.areas.hidden import STIFFNESS
from epcontact.bem.areas.rim_correction import COUNTED, HARMONIC, OBLONG, sums_of_fronts
from epcontact.reference import bumps
from epcontact.reference.waves import line_contact_fraction
from laboratory.areas import solution

#: Lattice directions of the fronts over an eighth of the circle; symmetry gives the
#: rest.
DIRECTIONS = (
    (1, 0),
    (23, 1),
    (17, 3),
    (15, 4),
    (13, 5),
    (11, 7),
    (13, 9),
    (11, 9),
    (1, 1),
)
#: Period of the waviness in grid spacings, and hardnesses in units of E* h/dx, which
#: give strips of widths from 0 to 4 dx.
PERIOD = 40
HARDNESSES = (
    *(
        0.003,
        0.006,
        0.01,
        0.014,
        0.018,
        0.022,
        0.026,
        0.03,
        0.034,
        0.037,
        0.04,
        0.043,
        0.046,
    ),
    *(0.05, 0.053, 0.056, 0.06, 0.063, 0.066, 0.07, 0.074, 0.078, 0.083, 0.09, 0.095),
)
#: Weight of the second differences of the table in the fit.
SMOOTHING = 0.003


def fold(x):
    """Return x minus the multiple of 2 pi that brings it into [-pi, pi)."""
    return np.asarray((x + np.pi) % (2 * np.pi) - np.pi)


def front_offset(angle, limit=400 * math.pi, points=2_000_000):
    """Return the offset, in grid spacings, of a boundary of contact that is counted in
    grid points.

    `angle` (rad) is that of the boundary's normal to a row of the grid. The offset is
    an integral over wavenumbers; beyond `limit`, ln|q| is replaced by its mean over the
    Brillouin zone, ln pi + ln(2)/2 - 3/2 + pi/4. `points` is the number of nodes of the
    integral.
    """
    c, s = math.cos(angle), math.sin(angle)
    begin = math.pi / max(abs(c), abs(s))
    t = begin + (np.arange(points) + 0.5) * (limit - begin) / points
    folded = np.hypot(fold(t * c), fold(t * s))
    integral = float(np.sum(np.log(folded / t) / t**2)) * (limit - begin) / points
    mean = math.log(math.pi) + math.log(2) / 2 - 1.5 + math.pi / 4
    return -(integral + (mean - math.log(limit) - 1) / limit) / math.pi


def wave(points, phase=0.0):
    """Return one period of a cosine at `points` points, shifted by `phase` points."""
    return np.cos(2 * np.pi * (np.arange(points) + phase) / points)


def row_period(direction, period):
    """Return the number of rows across a lattice direction, and their length in grid
    spacings, nearest to a period.

    Every column of the grid meets every row of the returned number.
    """
    norm = math.hypot(*direction)
    rows = 2 * round(period * norm / 2)
    while math.gcd(rows, direction[0]) > 1:
        rows += 2
    return rows, rows / norm


def link_of(v, hardness=math.inf):
    """Return the `Links` of a row of six values, from the contact outwards, as numbers.

    `v` are pressures less stiffness times gap; nothing has flowed before.
    """
    values = np.zeros((ROWS, 1))
    values[:6, 0] = v
    values[TOP, 0] = hardness
    found = np.zeros((len(Links._fields), 1))
    for find in (locate, locate_special):
        find(values, 1, hardness, Links(*found))
    return Links(*found[:, 0])


def front_sums(direction, period, phase, load, hardness=math.inf):
    """Return the sums of `grid.sweep` over one straight boundary of contact, per grid
    spacing of its length.

    The heights are a cosine across a lattice `direction`, with the period of
    `row_period` in spacings, shifted by `phase` points; load and hardness are over E*.
    Returns the sums with the first node of the table of offsets alone, and the offsets
    (nodes, 2) with each node.
    """
    (a, b), (n, length) = direction, row_period(direction, period)
    q = 2 * np.pi * np.arange(n // 2 + 1) / n
    folded = np.hypot(fold(q * a), fold(q * b))
    folded[0] = np.inf
    options, heights = Options(tolerance=1e-7), wave(n, phase)
    found = solve_pressure(heights, 2 / folded, load, hardness, options=options)
    p, g = found.pressure, found.gap(heights)
    column = (
        a * np.arange(n)[:, None] + b * (np.arange(6) - 2)
    ) % n  # this strip meets every row
    fields, stiffness = (
        (p[column], g[column], hardness * (1 - 1e-12)),
        (STIFFNESS, STIFFNESS),
    )
    flow = np.zeros((0, 0)), hardness
    # Cells whose last corner is in the fourth of the six columns have all that they
    # need.
    block = np.array([[0, n, 3, 4]])
    found = grid.Solution(*fields, stiffness, *flow)
    tables = np.eye(len(WIDTHS))
    out = [np.array(grid.sweep(found, block, table)[0].tolist()).T for table in tables]
    scale = length / 2 / n
    return out[0] * scale, np.array([grid.Sums(*sums).offset for sums in out]) * scale


def exact_fronts(hardness, period, points=1 << 16):
    """Return the half-widths, in grid spacings, of the contact and of the plastic part
    of one wave, solved on a fine line of `points` points.

    Without an elastic part both are a quarter of the period.
    """
    spacing = period / points
    p, g, *_ = solution(wave(points, 0.3), hardness / 2, hardness, (period,))
    field = p - STIFFNESS / spacing * g
    contact = _length(field) / 2 * spacing
    plastic = (points - _length(hardness - field)) / 2 * spacing
    return (contact, plastic) if contact > plastic else (period / 4, period / 4)


def _length(field):
    """Return the length, in points, on which a periodic field of a line is positive,
    with interpolated zero crossings.
    """
    after = np.roll(field, -1)
    crossing = (field > 0) != (after > 0)
    high, low = np.maximum(field, after)[crossing], np.minimum(field, after)[crossing]
    both = np.count_nonzero((field > 0) & (after > 0))
    inside = float(np.sum(high / (high - low)))
    return float(both + inside - np.count_nonzero(crossing) * AXIS_OFFSET)


#: (lattice direction, weight of each phase, phases)
Fronts = list[tuple[tuple[int, int], float, list[float]]]


def all_directions(along=40, across=2):
    """Return (lattice direction, weight of each phase, phases) of straight boundaries
    in all directions.

    Directions along the grid or its diagonal have `along` phases, the others `across`.
    """
    angles = np.array([math.atan2(b, a) for a, b in DIRECTIONS])
    weights = np.diff(np.r_[angles[0], (angles[1:] + angles[:-1]) / 2, angles[-1]])
    weights /= weights.sum()
    counts = [along if max(direction) == 1 else across for direction in DIRECTIONS]
    return [
        (direction, float(weight) / count, [(k + 0.5) / count for k in range(count)])
        for direction, weight, count in zip(DIRECTIONS, weights, counts, strict=True)
    ]


def calibrate_directions():
    """Return the mean offset of one boundary over all angles in grid spacings, the
    amplitude of its cos(4 theta) over the mean, and its scatter.

    The scatter, in spacings, is the largest rms deviation of all directions, over
    positions of the boundary.
    """
    load, exact = 0.5, line_contact_fraction(0.5) / 2
    offsets, weights = [], []
    for direction, weight, phases in all_directions(40, 1):
        weights.append(weight * len(phases))
        period = row_period(direction, PERIOD)[1]
        each = [
            front_sums(direction, PERIOD, s, load * math.pi / period)[0] for s in phases
        ]
        sums = grid.Sums(*np.array(each)[..., 0].T)
        offsets.append((sums.area - exact * period) / (sums.length + sums.shared))
    waves = np.array([math.cos(4 * math.atan2(b, a)) for a, b in DIRECTIONS])
    means = [each.mean() for each in offsets]
    amplitude, _ = np.polyfit(waves, means, 1)
    mean = np.average(means - amplitude * waves, weights=weights)
    fit = mean + amplitude * waves
    scatter = max(
        np.sqrt(np.mean((a - b) ** 2)) for a, b in zip(offsets, fit, strict=True)
    )
    return float(mean), float(amplitude / mean), float(scatter)


def calibrate_strips(fronts):
    """Return the offsets at WIDTHS, in grid spacings, of a boundary with another one
    beside it, and the largest misfit.

    WIDTHS are the widths of the strip between both. The fit is by least squares over
    HARDNESSES, each averaged over directions and positions.
    """
    features, biases = [], []
    for hardness in HARDNESSES:
        contact, plastic = exact_fronts(hardness, PERIOD)
        feature, bias = np.zeros(len(WIDTHS)), 0.0
        for direction, weight, phases in fronts:
            scale = row_period(direction, PERIOD)[1] / PERIOD
            for phase in phases:
                cap = hardness / scale
                sums, nodes = front_sums(direction, PERIOD, phase, cap / 2, cap)
                feature += weight * nodes.mean(axis=1)
                outer, inner = (
                    grid.Sums(*sums).area - np.array([contact, plastic]) * scale
                )
                bias += weight * (outer - inner) / 2
        features.append(feature)
        biases.append(bias)
    table = _fit(np.array(features), np.array(biases))
    return table, float(np.abs(np.array(features) @ table - biases).max())


def _fit(features, biases):
    """Return the table of offsets (nodes,), with small second differences and 0 for a
    strip without width.

    `features` (n, nodes) times the table gives `biases` (n,), in grid spacings.
    """
    nodes = WIDTHS
    smooth = np.zeros((len(nodes) - 1, len(nodes)))
    for i, (left, right) in enumerate(pairwise(1 / np.diff(nodes))):
        smooth[i, i : i + 3] = left, -left - right, right
    smooth *= SMOOTHING
    smooth[-1, 0] = 100
    target = np.r_[biases, np.zeros(len(smooth))]
    return np.asarray(np.linalg.lstsq(np.r_[features, smooth], target, rcond=None)[0])


def spheres(shape, radius, seed, shifts):
    """Yield the sums over the contact's boundary of a sphere at random places, and its
    exact contact area in cells, by Hertz; those of one part where the parts are alike.

    The square has side 1 and `shape` points, the contact the given radius, and `shifts`
    is the number of places.
    """
    force = 4 / 3 * radius**3
    exact = math.pi * bumps.sphere_contact_radius_periodic(force, 1.0, 1.0, 1.0) ** 2
    for shift in np.random.default_rng(seed).uniform(size=(shifts, 2)):
        x, y = ((np.arange(n) + s) / n - 0.5 for n, s in zip(shape, shift, strict=True))
        sphere = solution(-(x[:, None] ** 2 + y**2) / 2, force)
        sums, _, cells, _ = sums_of_fronts(*sphere)
        yield grid.Sums(*(a[0] for a in sums)), exact * cells


def calibrate_corner(radius=5.0, shifts=24):
    """Return the area in cells that a round contact lacks because its boundary is
    curved, and the standard error.

    `radius` is that of the contact in cells, `shifts` the number of places.
    """
    n = 2 * round(radius / 0.3)
    out = [
        (exact - sums.area + sums.offset + HARMONIC * sums.offset_cos) / sums.turn
        for sums, exact in spheres((n, n), radius / n, 1, shifts)
    ]
    return float(np.mean(out)), float(np.std(out) / math.sqrt(shifts))


def calibrate_oblong(aspect=2.0, points=30, shifts=24):
    """Return OBLONG, the relative growth of the mean offset over ln^2(dx/dy), from
    spheres on a grid with dx/dy = `aspect`.
    """
    nx, ny = (2 * round(points * aspect**power) for power in (-0.5, 0.5))
    lacking = offset = 0.0
    for sums, exact in spheres((nx, ny), 0.15, 2, shifts):
        outward = sums.offset + HARMONIC * sums.offset_cos
        lacking += sums.area - outward + CORNER * sums.turn - exact
        offset += sums.offset
    return lacking / offset / math.log(aspect) ** 2


def released(heights, compliance, load, hardness, after):
    """Return pressure, gap and plastic displacement of a line that is unloaded from
    `load` to `after` times the load.

    Pressures and `hardness` are over E*; heights (n,) and gaps are in grid spacings,
    and `compliance` is that of each Fourier mode.
    """
    options = Options(tolerance=1e-8)
    peak = solve_pressure(heights, compliance, load, hardness, options=options)
    flow = np.where(peak.pressure >= hardness, np.maximum(-peak.gap(heights), 0), 0)
    left = heights - flow
    found = solve_pressure(left, compliance, after * load, hardness, options=options)
    return found.pressure, found.gap(left), flow


def calibrate_release(phases=16, points=1 << 15):
    """Return the width by which straight boundaries come off the edges of flattened
    spots, over that of `front.released_width`.

    It is the mean over directions, positions, hardnesses and loads.
    """
    q, spacing = 2 * np.pi * np.arange(points // 2 + 1) / PERIOD, PERIOD / points
    need = release = 0.0
    q[0] = np.inf
    for hardness, after in itertools.product((0.01, 0.02, 0.03), (0.95, 0.85, 0.7)):
        p, g, _ = released(wave(points, 0.3), 2 / q, hardness / 2, hardness, after)
        exact = _length(p - STIFFNESS / spacing * g) / 2 * spacing
        for (a, b), weight, places in all_directions(phases, 2):
            n, length = row_period((a, b), PERIOD)
            across = 2 * np.pi * np.arange(n // 2 + 1) / n
            folded = np.hypot(fold(across * a), fold(across * b))
            folded[0] = np.inf
            column = (a * np.arange(n)[:, None] + b * (np.arange(6) - 2)) % n
            cap = hardness * PERIOD / length
            for phase in places:
                fields = released(wave(n, phase), 2 / folded, cap / 2, cap, after)
                p, g, flow = (field[column] for field in fields)
                solution = grid.Solution(
                    p, g, np.inf, (STIFFNESS, STIFFNESS), flow, cap
                )
                sums = grid.sweep(solution, np.array([[0, n, 3, 4]]), OFFSETS)[0, 0]
                sums = grid.Sums(*sums)
                area = sums.area - sums.offset - HARMONIC * sums.offset_cos
                need += weight * (area * length / 2 / n - exact * length / PERIOD)
                release += weight * sums.released * length / 2 / n
    return float(1 + need / release)


def main():
    """Print the constants and the table of offsets of `bem.areas`, calibrated anew,
    beside those in use.
    """
    print("offset of a counted front along an axis", round(front_offset(0.0), 5))
    angles = (np.arange(16) + 0.5) * math.pi / 64
    counted = np.mean([front_offset(angle, points=200_000) for angle in angles])
    print("of all directions", round(float(counted), 4), "in use", COUNTED)
    mean, amplitude, scatter = calibrate_directions()
    print(
        "offset of a located front",
        round(mean, 4),
        "(1 +",
        round(amplitude, 4),
        "cos 4 theta)",
    )
    print("scatter of it", round(scatter, 4), "in use", 0.4 * HARMONIC * OFFSETS[-1])
    print("u     ", WIDTHS)
    table, misfit = calibrate_strips(all_directions())
    print("offset", np.round(table, 4), " largest misfit", round(misfit, 4))
    print("corner", "{:.3f} +- {:.3f}".format(*calibrate_corner()), "in use", CORNER)
    print("oblong", round(calibrate_oblong(), 3), "in use", OBLONG)
    print("release", round(calibrate_release(), 3), "in use 1")


if __name__ == "__main__":
    main()
