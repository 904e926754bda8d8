"""Gates: two answers, or an answer and a reference, held against each other.

A gate reads one quantity of one method, and of another method, a closed form or a published
number, and judges their difference d by a norm:

    relative         d = (a - b) / b
    absolute         d = a - b
    wasserstein      d = int |F_a - F_b| dsigma / scale, F the distribution of the pressure on the
                     contact, scale the hardness, or the mean contact pressure where that is
                     infinite (Wasserstein-1)
    supremum         d = sup |F_a - F_b| over the pressures below the hardness, F the share of
                     the nominal area at pressures in (0, sigma], divided by the contact area of b
    l2               d = ||a - b||_2 / ||b||_2 of a field, over the grid

Ensembles carry their scatter into the verdict.  With n surfaces the interval of the mean is
Student's at 95 %; a gate holds only if the *whole* interval of the difference lies within its
band, so that an ensemble too small to tell cannot pass.  Two ensembles over the same seeds are
compared pair by pair.  A single surface has no interval and is taken at its word.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from epcontact.errors import InvalidCase, InvalidScene
from epcontact.results import APART, ContactResult, PressureDistribution

CONFIDENCE = 0.95
NORMS = ("relative", "absolute", "wasserstein", "supremum", "l2")
DISTRIBUTION_NORMS = ("wasserstein", "supremum")


@dataclass(frozen=True)
class Estimate:
    """A mean over an ensemble, the half-width of its 95 % interval, and the values themselves."""

    mean: float
    half_width: float
    deviation: float
    values: tuple[float, ...]

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.mean - self.half_width

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.mean + self.half_width


@dataclass(frozen=True)
class Gate:
    """What is asked: see the module's docstring.

    quantity: such as area.plastic.corrected, quantity.mean_gap, residual.gap, distribution or
        field.pressure.
    of, against: a method; against may also be a number or a closed form's name.
    low, high: the band in which the difference must lie.
    because: why the band is as wide as it is.
    """

    quantity: str
    of: str
    against: str | float
    norm: str
    low: float
    high: float
    because: str
    source: str = ""

    @property
    def name(self) -> str:
        """One line for tables and test reports."""
        against = self.against if isinstance(self.against, str) else f"{self.against:g}"
        return f"{self.quantity} of {self.of} against {against} ({self.norm})"


@dataclass(frozen=True)
class Verdict:
    """What came out of one gate."""

    gate: Gate
    value: Estimate
    reference: Estimate
    difference: Estimate
    holds: bool


def estimate(values: Sequence[float]) -> Estimate:
    """Mean and 95 % Student interval of independent values; one value has half-width 0."""
    array = np.asarray(values, dtype=float)
    if array.size == 1:
        return Estimate(float(array[0]), 0.0, 0.0, (float(array[0]),))
    deviation = float(array.std(ddof=1))
    factor = float(stdtrit(array.size - 1, 0.5 + CONFIDENCE / 2))
    half_width = factor * deviation / math.sqrt(array.size)
    return Estimate(float(array.mean()), half_width, deviation, tuple(map(float, array)))


def read_quantity(result: ContactResult, name: str) -> float:
    """The scalar called `name` at the last load step.

    Names: area.<total|elastic|plastic>.<raw|corrected|error>, quantity.<…>, residual.<…>,
    iterations.<…>, cost.<…>, mean_pressure.  Raises InvalidCase if there is none.
    """
    known = scalar_quantities(result)
    if name not in known:
        raise InvalidCase(
            f"{result.method} has no quantity {name!r}; it has {', '.join(sorted(known))}"
        )
    return known[name]


def scalar_quantities(result: ContactResult) -> dict[str, float]:
    """Every scalar of the last load step by the name a gate calls it."""
    final = result.final
    known = {"mean_pressure": final.mean_pressure}
    for kind, areas in final.areas.items():
        for part in ("total", "elastic", "plastic"):
            known[f"area.{part}.{kind}"] = getattr(areas, part)
    groups: dict[str, Mapping[str, Any]] = {
        "quantity": final.quantities,
        "residual": final.residuals,
        "iterations": final.iterations,
        "cost": result.cost,
    }
    for group, values in groups.items():
        known |= {f"{group}.{key}": float(value) for key, value in values.items()}
    return known


def distance(norm: str, a: PressureDistribution, b: PressureDistribution, hardness: float) -> float:
    """The distance of two pressure distributions by `norm`, wasserstein or supremum.

    Between tabulated pressures the distributions are taken as linear, so each should be
    tabulated finely.  Raises InvalidCase if one of them has no contact.
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
    scale = hardness if math.isfinite(hardness) else _mean_pressure(b) / total_b
    return float(np.trapezoid(difference, sigma) / scale)


def _mean_pressure(distribution: PressureDistribution) -> float:
    """int sigma dF over the elastic contact: the mean pressure where nothing is plastic."""
    sigma, F = distribution.pressure, distribution.cumulative
    return float(np.sum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(F)))


def l2_distance(found: NDArray[Any], exact: NDArray[Any]) -> float:
    """||found - exact||_2/||exact||_2 of two fields on one grid."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


@dataclass(frozen=True)
class Difference:
    """Of one answer from another.

    area: relative difference of the raw contact areas.  pressure: L2 norm of the difference of
    the nodal pressures over that of the second.  overlap: shared contact nodes over all nodes in
    either contact (Jaccard).  wasserstein: distance of the pressure distributions, as in
    `compare`.  nodes: how many differ in being in contact.  areas: both raw areas.
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
    """Of `first` from `second`, on one grid; hardness (Pa) scales the distributions' distance."""
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


def judge(gate: Gate, value: Sequence[float], reference: Sequence[float], paired: bool) -> Verdict:
    """Hold the values of a scalar quantity against those of its reference."""
    a, b = estimate(value), estimate(reference)
    if not paired:
        return judge_estimates(gate, a, b)
    difference = estimate(
        [_difference(gate.norm, x, y) for x, y in zip(value, reference, strict=True)]
    )
    return Verdict(gate, a, b, difference, _within(gate, difference))


def judge_estimates(gate: Gate, a: Estimate, b: Estimate) -> Verdict:
    """Hold one estimate with its interval against another, the two being independent.

    A limit of a convergence study with its uncertainty is such an estimate too.
    """
    half_width = math.hypot(a.half_width, b.half_width)
    if gate.norm == "relative":
        # First order: the relative difference is (a - b)/b, so b's width counts times a/b.
        scale = abs(b.mean) or math.inf
        half_width = math.hypot(a.half_width, a.mean / scale * b.half_width) / scale
    mean = _difference(gate.norm, a.mean, b.mean)
    difference = Estimate(mean, half_width, math.nan, ())
    return Verdict(gate, a, b, difference, _within(gate, difference))


def judge_distance(gate: Gate, distances: Sequence[float]) -> Verdict:
    """Hold distances, one a surface, against the gate's band; the reference is zero distance."""
    difference = estimate(distances)
    return Verdict(gate, difference, estimate([0.0]), difference, _within(gate, difference))


def _difference(norm: str, value: float, reference: float) -> float:
    if norm == "absolute":
        return value - reference
    if reference == 0:
        return 0.0 if value == 0 else math.copysign(math.inf, value)
    return (value - reference) / abs(reference)


def _within(gate: Gate, difference: Estimate) -> bool:
    # NaN compares false: a difference that is no number never holds.
    return gate.low <= difference.low and difference.high <= gate.high
