"""The distribution of the contact pressures of a solution, and the effect of the grid
at its ends.

P(sigma) is the share of the nominal area per pressure.  Near a rim the pressure rises
as the square root of the distance, p = K sqrt(s), so in the continuum P(sigma) = slope
sigma -> 0 at sigma -> 0, with slope = 2 x the integral of K^-2 along the rims; by
particle-hole symmetry the same holds at the hardness.  On a grid the points next to the
rim, with pressures of the order K sqrt(dx), fill the ends: P(0+) > 0 falls as dx^(1/2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import Areas, FloatArray, PressureDistribution

# A pressure above this share of the hardness is plastic: the difference is rounding.
_ROUNDING = 1 - 1e-12
_CHUNK = 1 << 20  # points taken at a time, so that no temporary has the grid's size


def graded_pressures(largest: float, bins: int, *, both_ends: bool) -> FloatArray:
    """(bins + 1,) pressures in Pa from 0 to `largest`, close together at 0, or at both
    ends.  They are quadratic there, so that bins have about the same number of points
    where P is linear.
    """
    angle = np.pi / 2 * np.arange(bins + 1) / bins
    grades = np.sin(angle) ** 2 if both_ends else 1 - np.cos(angle)
    grades[-1] = 1.0
    return np.asarray(largest * grades)


def pressure_distribution(
    pressure: FloatArray,
    hardness: float,
    bins: int | Sequence[float] | FloatArray = 200,
) -> PressureDistribution:
    """The distribution of a pressure field, of any shape, by counting its points.

    bins: their number, finer towards 0 and the hardness (if this is infinite, towards
    0, up to the largest pressure), or their ascending edges in Pa from 0 on.
    """
    finite = math.isfinite(hardness)
    flat = pressure.reshape(-1)
    largest = hardness if finite else max(float(flat.max()), np.finfo(float).tiny)
    if isinstance(bins, int | np.integer):
        if bins < 1:
            raise InvalidScene(f"bins is {bins}, but at least one is needed")
        edges = graded_pressures(largest, int(bins), both_ends=finite)
    else:
        edges = np.asarray(bins, dtype=np.float64)
        if (
            edges.ndim != 1
            or edges.size < 2
            or edges[0] != 0
            or not np.all(np.diff(edges) > 0)
        ):
            raise InvalidScene(
                "bins must be a number, or edges in Pa that ascend from 0"
            )
    counts, plastic = np.zeros(edges.size, dtype=np.int64), 0
    for start in range(0, flat.size, _CHUNK):
        p = flat[start : start + _CHUNK]
        p = np.sort(p[p > 0])  # cheaper than to look up the bin of each point
        flowing = int(np.searchsorted(p, hardness * _ROUNDING))
        plastic += p.size - flowing
        # side="right": a pressure on an edge belongs to the bin below it, (edge[i-1],
        # edge[i]].
        counts += np.searchsorted(p[:flowing], edges, side="right")
    return PressureDistribution(edges, counts / flat.size, plastic / flat.size)


@dataclass(frozen=True)
class EndFit:
    """P(sigma) near an end, as a function of the distance from it (Pa).

    The straight line of `density` (1/Pa) and `slope` (1/Pa^2) has the area and the mean
    pressure of the points in a window, with the effect of the grid.  That of
    `continuum_slope` goes through zero and has the corrected area in it.
    """

    density: float
    slope: float
    continuum_slope: float


def end_fits(
    pressure: FloatArray, hardness: float, window: float, areas: tuple[Areas, Areas]
) -> tuple[EndFit, EndFit]:
    """Fit P(sigma) near 0 and near the hardness.

    window: in Pa, several times the pressure of the points next to the rim, but small
    beside the width of P, so that the surplus area of the counted rims is within it;
    areas: (raw, corrected).
    """
    p = pressure[(pressure > 0) & (pressure < hardness * _ROUNDING)]
    raw, corrected = areas
    surplus = raw.total - corrected.total, corrected.plastic - raw.plastic
    near, n = (
        [distance[distance <= window] for distance in (p, hardness - p)],
        pressure.size,
    )
    low, high = (
        end_fit(some.size / n, float(some.sum()) / n, window, of_grid)
        for some, of_grid in zip(near, surplus, strict=True)
    )
    return low, high


def end_fit(share: float, moment: float, window: float, surplus: float = 0.0) -> EndFit:
    """The fit to a share of the nominal area within `window` w (Pa) of an end.

    moment: integral of the distance from the end over that share, Pa; surplus: the part
    of the share that is due to the grid.  The line has share d w + s w^2/2 and moment d
    w^2/2 + s w^3/3.
    """
    slope = 12 * moment / window**3 - 6 * share / window**2
    density = share / window - slope * window / 2
    return EndFit(density, slope, 2 * (share - surplus) / window**2)


def extrapolated(
    points: FloatArray, values: FloatArray, order: float
) -> tuple[float, float]:
    """(limit, error) of values for ever more points n per wavelength, v = limit + c
    n^-order.

    order: 1/2 for the density of `EndFit`, 1 for raw areas.  The error of the
    least-squares fit is its standard error, or twice the change of the limit without
    the coarsest value, whichever is larger; with two values it is the distance of the
    limit from the finer one.
    """
    x = points**-order
    limit, rest = float(np.polyfit(x, values, 1)[1]), x < x.max()
    if x.size == 2:
        return limit, float(abs(limit - values[rest][0]))
    spread = math.sqrt(np.polyfit(x, values, 1, cov=True)[1][1, 1])
    return limit, max(
        spread, 2 * abs(limit - float(np.polyfit(x[rest], values[rest], 1)[1]))
    )
