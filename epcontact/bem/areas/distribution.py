"""The distribution of the contact pressures, and the effect of the grid at its ends.

P(sigma) is the fraction of the nominal area per pressure.  Near a rim the pressure
rises as the square root of the distance, p = K sqrt(s).  So in the continuum P(sigma) =
slope sigma -> 0 at sigma -> 0, where the slope is twice the integral of K^-2 along the
rims.  By particle-hole symmetry the same holds at the hardness.  On a grid the points
next to the rim, with pressures of the order K sqrt(dx), fill the ends: P(0+) > 0 falls
as dx^(1/2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import Areas, FloatArray, PressureDistribution

# A pressure above this fraction of the hardness is plastic: the difference is rounding.
_ROUNDING = 1 - 1e-12
_CHUNK = 1 << 20  # points taken at a time, so that no temporary has the grid's size


def graded_pressures(largest: float, bins: int, *, both_ends: bool) -> FloatArray:
    """Return the edges (bins + 1,) of bins of pressure in Pa, from 0 to `largest`.

    The edges are close together near 0, and with `both_ends` near `largest`, too: their
    distance grows linearly there.  Bins then hold about the same number of grid points
    where the density of the pressure is linear in the pressure.
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
    """Return the distribution of a pressure field by counting its points.

    Args:
        pressure: in Pa, of any shape.
        hardness: in Pa, may be infinite.
        bins: their number, or their ascending edges in Pa from 0 on.  A number of bins
            is finer towards 0 and the hardness; if this is infinite, they reach up to
            the largest pressure and are finer towards 0.

    Raises:
        InvalidScene: the bins are not valid.
    """
    flat = pressure.reshape(-1)
    edges = _edges(flat, hardness, bins)
    counts = np.zeros(edges.size, dtype=np.int64)
    plastic = 0
    for start in range(0, flat.size, _CHUNK):
        p = flat[start : start + _CHUNK]
        p = np.sort(p[p > 0])  # cheaper than to look up the bin of each point
        elastic = int(np.searchsorted(p, hardness * _ROUNDING))
        plastic += p.size - elastic
        # A pressure on an edge belongs to the bin below it, (edge[i-1], edge[i]].
        counts += np.searchsorted(p[:elastic], edges, side="right")
    return PressureDistribution(edges, counts / flat.size, plastic / flat.size)


def _edges(
    pressure: FloatArray, hardness: float, bins: int | Sequence[float] | FloatArray
) -> FloatArray:
    """Return the ascending edges (m,) of bins of pressure in Pa, from 0 on.

    pressure: (n,) in Pa, whose largest value ends the bins if the hardness is infinite;
    hardness: in Pa; bins: number of bins, or their edges, which are returned.

    Raises InvalidScene if there are no bins, or the edges do not ascend from 0.
    """
    if isinstance(bins, int | np.integer):
        if bins < 1:
            raise InvalidScene(f"bins is {bins}, but at least one is needed")
        finite = math.isfinite(hardness)
        largest = hardness
        if not finite:
            largest = max(float(pressure.max()), np.finfo(float).tiny)
        return graded_pressures(largest, int(bins), both_ends=finite)
    edges = np.asarray(bins, dtype=np.float64)
    ascending = edges.ndim == 1 and edges.size > 1 and np.all(np.diff(edges) > 0)
    if not ascending or edges[0] != 0:
        raise InvalidScene("bins must be a number, or edges in Pa that ascend from 0")
    return edges


@dataclass(frozen=True)
class EndFit:
    """P(sigma) near an end, as a function of the distance from it.

    Attributes:
        density: in 1/Pa, at the end.
        slope: in 1/Pa^2.  The straight line of density and slope has the area and the
            mean pressure of the points in a window, with the effect of the grid.
        continuum_slope: in 1/Pa^2, of the line through zero that has the corrected area
            in the window.
    """

    density: float
    slope: float
    continuum_slope: float


def end_fits(
    pressure: FloatArray, hardness: float, window: float, areas: tuple[Areas, Areas]
) -> tuple[EndFit, EndFit]:
    """Return fits of the density of pressures near 0 and near the hardness.

    The density P(sigma) is the fraction of the nominal area per pressure (1/Pa).

    Args:
        pressure: in Pa, of any shape.
        hardness: in Pa.
        window: in Pa, several times the pressure of the points next to the rim, but
            small beside the width of P, so that the surplus area of the counted rims is
            within it.
        areas: raw and corrected areas as fractions of the nominal area.

    Returns:
        The fit near 0, and that near the hardness.
    """
    elastic = pressure[(pressure > 0) & (pressure < hardness * _ROUNDING)]
    raw, corrected = areas
    fits = []
    for distance, surplus in (
        (elastic, raw.total - corrected.total),
        (hardness - elastic, corrected.plastic - raw.plastic),
    ):
        near = distance[distance <= window]
        area = near.size / pressure.size
        moment = float(near.sum()) / pressure.size
        fits.append(end_fit(area, moment, window, surplus))
    return fits[0], fits[1]


def end_fit(area: float, moment: float, window: float, surplus: float = 0.0) -> EndFit:
    """Return the fit of a density of pressures near one end of its range.

    The end is 0 or the hardness.  The window is the range of pressures next to it, and
    w is its width.  The line of density d and slope s has the area d w + s w^2/2 and
    the moment d w^2/2 + s w^3/3 within the window.

    Args:
        area: area with a pressure in the window, as a fraction of the nominal area.
        moment: integral of the distance from the end (Pa) over this area fraction.
        window: width of the window in Pa.
        surplus: the part of the area that is due to the grid, as a fraction of the
            nominal area.
    """
    slope = 12 * moment / window**3 - 6 * area / window**2
    density = area / window - slope * window / 2
    return EndFit(density, slope, 2 * (area - surplus) / window**2)


def extrapolate(
    points: FloatArray, values: FloatArray, order: float
) -> tuple[float, float]:
    """Return the limit of values on ever finer grids, and its error.

    The values are fitted by limit + c n^-order, with n the points per wavelength.
    The error is the standard error of the least-squares fit, or twice the change of the
    limit without the coarsest value, whichever is larger.  With two values it is the
    distance of the limit from the value on the finer grid.

    Args:
        points: (m,) points per wavelength, in any order.
        values: (m,) the values on these grids.
        order: 1/2 for the density of `EndFit`, 1 for raw areas.
    """
    x = points**-order
    finer = x < x.max()
    limit = float(np.polyfit(x, values, 1)[1])
    if x.size == 2:
        return limit, float(abs(limit - values[finer][0]))
    standard_error = math.sqrt(np.polyfit(x, values, 1, cov=True)[1][1, 1])
    without_coarsest = float(np.polyfit(x[finer], values[finer], 1)[1])
    return limit, max(standard_error, 2 * abs(limit - without_coarsest))
