"""Straight fronts on a square grid as rows across a lattice direction: problems on a line.

A straight front meets the grid as rows: with the normal along the lattice direction (a, b), rows
h = dx/sqrt(a^2 + b^2) apart, each of them at one pressure.  Their compliance at the wave number
q is that of the grid at q n folded into its first Brillouin zone, 2/(E* |fold(q n)|).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from epcontact.bem import Options, solve_pressure
from epcontact.bem.areas import surface as sweep
from epcontact.bem.areas.front import STIFFNESS, kind
from epcontact.results import FloatArray


def fold(x: FloatArray) -> FloatArray:
    """x less the multiple of 2 pi that brings it into [-pi, pi)."""
    return np.asarray((x + np.pi) % (2 * np.pi) - np.pi)


def front_offset(angle: float, limit: float = 400 * math.pi, points: int = 2_000_000) -> float:
    """delta/dx of a counted front with its normal at `angle` (rad) to a row, by the integral.

    Beyond `limit` the mean of ln|q| over the zone, ln pi + ln(2)/2 - 3/2 + pi/4, stands in.
    """
    c, s = math.cos(angle), math.sin(angle)
    begin = math.pi / max(abs(c), abs(s))
    t = begin + (np.arange(points) + 0.5) * (limit - begin) / points
    folded = np.hypot(fold(t * c), fold(t * s))
    integral = float(np.sum(np.log(folded / t) / t**2)) * (limit - begin) / points
    mean = math.log(math.pi) + math.log(2) / 2 - 1.5 + math.pi / 4
    return -(integral + (mean - math.log(limit) - 1) / limit) / math.pi


@dataclass(frozen=True)
class Rows:
    """A wave across a lattice direction: one number a row, the period in dx."""

    direction: tuple[int, int]
    pressure: FloatArray
    gap: FloatArray
    hardness: float
    period: float


def solve_wave(
    compliance: FloatArray, rows: int, phase: float, load: float, hardness: float
) -> tuple[FloatArray, FloatArray]:
    """(pressure, gap) of heights cos(2 pi (i + phase)/rows) on a line of that compliance."""
    heights = np.cos(2 * np.pi * (np.arange(rows) + phase) / rows)
    options = Options(tolerance=1e-7)
    solution = solve_pressure(heights, compliance, load, hardness, options=options)
    return solution.pressure, solution.displacement + solution.offset - heights


def row_period(direction: tuple[int, int], period: float) -> tuple[int, float]:
    """(rows, their length in dx) nearest to a period; columns of the grid meet every row."""
    norm = math.hypot(*direction)
    rows = 2 * round(period * norm / 2)
    while math.gcd(rows, direction[0]) > 1:
        rows += 2
    return rows, rows / norm


def solve_rows(
    direction: tuple[int, int], period: float, phase: float, load: float, hardness: float = math.inf
) -> Rows:
    """Waviness cos(2 pi x/period), period as of `row_period`, E* = dx = 1."""
    rows, length = row_period(direction, period)
    q = 2 * np.pi * np.arange(rows // 2 + 1) / rows
    folded = np.hypot(fold(q * direction[0]), fold(q * direction[1]))
    folded[0] = np.inf
    p, g = solve_wave(2 / folded, rows, phase, load, hardness)
    return Rows(direction, p, g, hardness, length)


def book_rows(rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Sums of `area_sweep` over a column of cells that meets every row, for one front per dx of
    it, and the same with each node of the table: (SUMS,), (nodes, 2)."""
    a, b = rows.direction
    n = rows.pressure.size
    k = (a * np.arange(n)[:, None] + b * (np.arange(6) - 2)) % n
    out = np.zeros((len(sweep.U_NODES), sweep.SUMS))
    p, g = rows.pressure[k], rows.gap[k]
    _column(p, g, rows.hardness * (1 - 1e-12), np.eye(len(out)), out)
    scale = rows.period / 2 / n
    return out[0] * scale, out[:, sweep.OFFSET : sweep.OFFSET + 2] * scale


@numba.njit  # not cached: what it calls is compiled into it, and lies elsewhere
def _column(
    p: FloatArray, g: FloatArray, hardness: float, tables: FloatArray, out: FloatArray
) -> None:
    work = sweep.workspace()
    for i in range(p.shape[0]):
        first = kind(p[i, 3], hardness)
        same = (
            kind(p[i - 1, 3], hardness) == first
            and kind(p[i, 2], hardness) == first
            and kind(p[i - 1, 2], hardness) == first
        )
        for k in range(len(tables)):
            if same:
                out[k, sweep.AREA] += first > 0
                out[k, sweep.AREA + 1] += first > 1
            else:
                sweep.book(p, g, hardness, (STIFFNESS, STIFFNESS), (i, 3), tables[k], out[k], work)
                if first != 1 and sweep.is_tip(p, hardness, i, 3, first):
                    out[k, sweep.TIPS + (first > 1)] += 1
