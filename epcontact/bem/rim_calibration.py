"""The discrete problem at a straight front: where the area estimates have their constants from.

A straight front across a square grid meets it as rows: with the normal along the lattice
direction (a, b), rows h = dx/sqrt(a^2 + b^2) apart, each of them at one pressure.  The rows form
a problem on a line, whose compliance at the wave number q is that of the grid at q n folded into
its first Brillouin zone, 2/(E* |fold(q n)|).

One front.  A Wiener-Hopf factorisation on the half-line of rows solves it: fronts of every
position are reached by the pressures (1/S_+) (alpha n + beta), 0 <= beta <= alpha, and far inside
these are the continuum's K sqrt(s) with the front shifted by
    delta(n)/dx = -(1/pi) int_0^inf ln(|fold(t n)|/t) dt/t^2
behind the edge of the counted cells, averaged over positions.  It is 0.190 along the grid's
axes, 0.134 along the diagonals, 0.129 in the mean over directions; per switch of a row or
column (4/pi of them a length dx of rim) 0.1014, where the published factor is 0.1181.  There is
no term of second order for a straight front.

Two fronts.  Where apart and plastic lie close to each other, an elastic strip of width w between
them, the offset depends on w/dx: it vanishes with w (the count is exact for a rigid-plastic
body), overshoots and settles to delta at w = dx.  Solutions over all w, directions and
positions calibrate what an estimate can see of a strip: the elastic points m along a row or column
between apart and plastic, and tau = H/(H + (E*/dx) |difference of the gaps at its ends|).

`python -m epcontact.bem.rim_calibration` prints the tables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.area_line import AXIS_OFFSET, WIDTH_NODES
from epcontact.bem.area_sweep import MEAN_OFFSET, TAU_NODES
from epcontact.bem.solver import Options, solve_pressure

FloatArray = NDArray[np.float64]

#: Lattice directions of the fronts, spread over the eighth of the circle that symmetry leaves.
DIRECTIONS = (
    *((1, 0), (23, 1), (19, 2), (17, 3), (15, 4), (13, 5), (12, 7)),
    *((11, 7), (13, 9), (11, 9), (12, 11), (1, 1)),
)
#: Period of the waviness in grid spacings, and hardness in units of E* h/dx: widths 0 to 6 dx.
PERIOD = 40
HARDNESSES = (
    *(0.003, 0.006, 0.01, 0.014, 0.018, 0.022, 0.026, 0.03, 0.034, 0.037, 0.04, 0.043, 0.046),
    *(0.05, 0.053, 0.056, 0.06, 0.063, 0.066, 0.07, 0.074, 0.078, 0.083, 0.09, 0.095),
)

#: Weight of the second differences of the tables.
SMOOTHING = 0.01


def fold(x: FloatArray) -> FloatArray:
    """x less the multiple of 2 pi that brings it into [-pi, pi)."""
    return np.asarray((x + np.pi) % (2 * np.pi) - np.pi)


def front_offset(angle: float, limit: float = 400 * math.pi, points: int = 2_000_000) -> float:
    """delta/dx for a front with its normal at `angle` (rad) to a row, by the integral above.

    Beyond `limit` the mean of ln|q| over the zone, ln pi + ln(2)/2 - 3/2 + pi/4, stands in.
    """
    c, s = math.cos(angle), math.sin(angle)
    begin = math.pi / max(abs(c), abs(s))
    t = begin + (np.arange(points) + 0.5) * (limit - begin) / points
    folded = np.hypot(fold(t * c), fold(t * s))
    integral = float(np.sum(np.log(folded / t) / t**2)) * (limit - begin) / points
    mean = math.log(math.pi) + math.log(2) / 2 - 1.5 + math.pi / 4
    return -(integral + (mean - math.log(limit) - 1) / limit) / math.pi


def mean_offset(directions: int = 180) -> float:
    """Mean of delta/dx over the directions, by the midpoint rule on an eighth of the circle."""
    angles = (np.arange(directions) + 0.5) / directions * math.pi / 4
    return float(np.mean([front_offset(a, 60 * math.pi, 400_000) for a in angles]))


@dataclass(frozen=True)
class Strip:
    """Two fronts on rows: pressure, gap, hardness, and the half-widths of the true areas (dx)."""

    pressure: FloatArray
    gap: FloatArray
    hardness: float
    spacing: float
    contact: float
    plastic: float


def _solve(
    compliance: FloatArray, rows: int, phase: float, hardness: float
) -> tuple[FloatArray, FloatArray]:
    heights = np.cos(2 * np.pi * (np.arange(rows) + phase) / rows)
    solution = solve_pressure(
        heights, compliance, hardness / 2, hardness, options=Options(tolerance=1e-7)
    )
    return solution.pressure, solution.displacement + solution.offset - heights


def exact_fronts(hardness: float, period: float, points: int = 1 << 16) -> tuple[float, float]:
    """Half-widths of contact and of the plastic part (dx) of one wave, on a very fine line."""
    spacing = period / points
    q = 2 * np.pi * np.arange(points // 2 + 1) / period
    q[0] = np.inf
    p, g = _solve(2 / q, points, 0.3, hardness)
    field = p - math.pi / (2 * math.e * spacing) * g
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


def strips(
    direction: tuple[int, int], hardness: float, fronts: tuple[float, float], shifts: int
) -> list[Strip]:
    """The two fronts across the lattice direction, at `shifts` positions between two rows."""
    a, b = direction
    norm = math.hypot(a, b)
    rows = 2 * round(PERIOD * norm / 2)
    # The period in dx is a multiple of the row spacing; the fronts are those of that period.
    scale = rows / norm / PERIOD
    q = 2 * np.pi * np.arange(rows // 2 + 1) * norm / rows
    folded = np.hypot(fold(q * a / norm), fold(q * b / norm))
    folded[0] = np.inf
    out = []
    for k in range(shifts):
        p, g = _solve(2 / folded, rows, (k + 0.5) / shifts, hardness / scale)
        out.append(Strip(p, g, hardness / scale, 1 / norm, fronts[0] * scale, fronts[1] * scale))
    return out


def _crossings(strip: Strip, step: int) -> list[tuple[int, float]]:
    """(m, tau) where lines that advance by `step` rows cross the two fronts, over all rows."""
    p, g, hardness = strip.pressure, strip.gap, strip.hardness
    found = []
    for first in range(math.gcd(p.size, step)):
        line = (first + step * np.arange(p.size // math.gcd(p.size, step))) % p.size
        apart, plastic = p[line] <= 0, p[line] >= hardness
        ends = np.flatnonzero(apart | plastic)
        after = np.roll(ends, -1)
        change = plastic[ends] != plastic[after]
        m = (after - ends - 1) % line.size
        tau = hardness / (hardness + np.abs(g[line[ends]] - g[line[after]]))
        found += [(int(i), float(t)) for i, t in zip(m[change], tau[change], strict=True)]
    return found


def _hats(tau: float) -> FloatArray:
    """Weights of the nodes in the linear interpolation at tau."""
    return np.array([np.interp(tau, TAU_NODES, row) for row in np.eye(len(TAU_NODES))])


def _features(strip: Strip, direction: tuple[int, int]) -> tuple[FloatArray, float]:
    """Per length of a front: hat weights for m = 0 and 1, counts of m = 2 and more; raw bias."""
    n = len(TAU_NODES)
    out = np.zeros(2 * n + 2)
    for step in direction:
        crossings = _crossings(strip, step) if step else []
        weight = step * strip.spacing / max(len(crossings), 1)
        for m, tau in crossings:
            if m <= 1:
                out[m * n : (m + 1) * n] += weight * _hats(tau)
            else:
                out[2 * n + (m > 2)] += weight
    half = strip.spacing / 2
    contact = np.count_nonzero(strip.pressure > 0) * half - strip.contact
    plastic = strip.plastic - np.count_nonzero(strip.pressure >= strip.hardness) * half
    return out, (contact + plastic) / 2


def calibrate_grid(shifts: int = 40) -> tuple[FloatArray, FloatArray, float, float]:
    """(m = 0 table, m = 1 table, m = 2 value, rms misfit): offsets in dx per crossing.

    Least squares over the widths of the strip, each the mean over directions and positions;
    second differences of the tables are held small, as single nodes are poorly determined.
    """
    angles = np.array([math.atan2(b, a) for a, b in DIRECTIONS])
    weights = np.diff(np.r_[angles[0], (angles[1:] + angles[:-1]) / 2, angles[-1]])
    weights /= weights.sum()
    rows, biases = [], []
    for hardness in HARDNESSES:
        fronts = exact_fronts(hardness, PERIOD)
        row, bias = 0.0, 0.0
        for direction, weight in zip(DIRECTIONS, weights, strict=True):
            count = shifts * (5 if max(direction) == 1 else 1)
            for strip in strips(direction, hardness, fronts, count):
                feature, raw = _features(strip, direction)
                row = row + weight / count * feature
                bias += weight / count * raw
        rows.append(row)
        biases.append(bias)
    return _fit(np.array(rows), np.array(biases))


def _fit(rows: FloatArray, biases: FloatArray) -> tuple[FloatArray, FloatArray, float, float]:
    n = len(TAU_NODES)
    generic = math.pi / 4 * MEAN_OFFSET
    target = biases - generic * rows[:, -1]
    smooth = np.zeros((2 * (n - 2) + 2, 2 * n + 1))
    nodes = np.array(TAU_NODES)
    for table in range(2):
        for i in range(1, n - 1):
            left, right = nodes[i] - nodes[i - 1], nodes[i + 1] - nodes[i]
            at = table * n + i
            row = smooth[table * (n - 2) + i - 1]
            row[at - 1 : at + 2] = 1 / left, -1 / left - 1 / right, 1 / right
        smooth[2 * (n - 2) + table, table * n] = 300  # no offset as w -> 0
    system = np.r_[rows[:, :-1], SMOOTHING * smooth]
    solution = np.linalg.lstsq(system, np.r_[target, np.zeros(len(smooth))], rcond=None)[0]
    misfit = float(np.sqrt(np.mean((rows[:, :-1] @ solution - target) ** 2)))
    return solution[:n], solution[n : 2 * n], float(solution[-1]), misfit


def calibrate_line(period: int = 400, shifts: int = 40) -> FloatArray:
    """Offsets in dx at WIDTH_NODES: of fronts interpolated on p - c g, by the strip's width so."""
    q = 2 * np.pi * np.arange(period // 2 + 1) / period
    q[0] = np.inf
    c = math.pi / (2 * math.e)
    widths, offsets = [0.0], [0.0]
    for hardness in np.linspace(2e-4, 5e-3, 150):
        contact, plastic = exact_fronts(hardness, period, 1 << 14)
        for k in range(shifts):
            p, g = _solve(2 / q, period, (k + 0.5) / shifts, hardness)
            outer = _length(p - c * g) / 2 + AXIS_OFFSET
            inner = (period - _length(hardness - p + c * g)) / 2 - AXIS_OFFSET
            widths.append(outer - inner)
            offsets.append((outer - contact + plastic - inner) / 2)
    order = np.argsort(widths)
    smooth = np.array([widths, offsets])[:, order]
    return np.array([_local_mean(smooth, node) for node in WIDTH_NODES])


def _local_mean(curve: FloatArray, at: float, half_width: float = 0.06) -> float:
    """Straight-line fit to the points of a curve near `at`, there."""
    near = np.abs(curve[0] - at) <= half_width
    x, y = curve[0][near] - at, curve[1][near]
    if at == 0:
        return 0.0
    return float(np.polyfit(x, y, 1)[1])


def main() -> None:
    """Print the constants and tables of `area_sweep` and `area_line`."""
    print("mean offset", round(mean_offset(720), 5), " along an axis", round(front_offset(0.0), 5))
    zero, one, two, misfit = calibrate_grid()
    print("tau   ", np.round(TAU_NODES, 4))
    print("m = 0 ", np.round(zero, 4))
    print("m = 1 ", np.round(one, 4))
    print("m = 2 ", round(two, 4), " rms misfit", round(misfit, 4))
    print("width ", np.round(WIDTH_NODES, 4))
    print("line  ", np.round(calibrate_line(), 4))


if __name__ == "__main__":
    main()
