"""Distances between two answers: between their fields and their pressure distributions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidCase, InvalidScene
from epcontact.results import APART, ContactResult, PressureDistribution


def distance(norm: str, a: PressureDistribution, b: PressureDistribution, hardness: float) -> float:
    """Return the distance of a pressure distribution from another one, the reference.

    "wasserstein" is int |F_a - F_b| dsigma over the hardness (Pa) or, if that is infinite, over the
    mean contact pressure of b, with F the distribution of the pressure on the contact.  "supremum"
    is the largest |F_a - F_b| below the hardness over the contact area of b, with F the share of
    the nominal area at pressures in (0, sigma].  The tables are interpolated linearly, so that
    their pressures should be close together.  Raises InvalidCase if there is no contact.
    """
    total_a = float(a.cumulative[-1]) + a.plastic
    total_b = float(b.cumulative[-1]) + b.plastic
    if min(total_a, total_b) <= 0:
        raise InvalidCase("a pressure distribution without contact has no distance to another")
    sigma = np.union1d(a.pressure, b.pressure)
    F_a = np.interp(sigma, a.pressure, a.cumulative)
    F_b = np.interp(sigma, b.pressure, b.cumulative)
    if norm == "supremum":
        return float(np.abs(F_a - F_b).max() / total_b)
    difference = np.abs(F_a / total_a - F_b / total_b)
    scale = hardness if math.isfinite(hardness) else carried_pressure(b) / total_b
    return float(np.trapezoid(difference, sigma) / scale)


def carried_pressure(distribution: PressureDistribution) -> float:
    """Return int sigma dF over the elastic contact, in Pa: its load per nominal area."""
    sigma, F = distribution.pressure, distribution.cumulative
    return float(np.sum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(F)))


def l2_distance(found: NDArray[Any], exact: NDArray[Any]) -> float:
    """Return ||found - exact||_2/||exact||_2 for two fields on one grid."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


@dataclass(frozen=True)
class Difference:
    """The difference between two answers on the same grid.

    `area` is the relative difference of the raw contact `areas`, `pressure` the L2 norm of the
    difference of the nodal pressures over that of the second, `overlap` the number of shared
    contact nodes over that of nodes in either contact (Jaccard index), `wasserstein` the distance
    of the distributions, and `nodes` the number of nodes that are in contact in one answer only.
    """

    area: float
    pressure: float
    overlap: float
    wasserstein: float
    nodes: int
    areas: tuple[float, float]

    def __str__(self) -> str:
        return f"area {self.area:+.2%}, pressure {self.pressure:.1e}"


def difference(first: ContactResult, second: ContactResult, hardness: float) -> Difference:
    """Return the difference of `first` from `second`; the hardness (Pa) scales their distance.

    Raises InvalidScene if their grids differ.
    """
    p, q = first.fields["pressure"], second.fields["pressure"]
    if p.shape != q.shape:
        raise InvalidScene(f"pressures on grids of {p.shape} and {q.shape} cannot be compared")
    a, b = first.fields["state"] != APART, second.fields["state"] != APART
    assert first.distribution is not None
    assert second.distribution is not None
    return Difference(
        float(a.mean() / b.mean() - 1),
        l2_distance(p, q),
        float((a & b).sum() / (a | b).sum()),
        distance("wasserstein", first.distribution, second.distribution, hardness),
        int((a != b).sum()),
        (float(a.mean()), float(b.mean())),
    )
