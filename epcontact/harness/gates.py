"""Gates: comparisons of two answers, or of an answer with a reference.

A gate compares one quantity a of a method with the reference b: the same quantity of
another method, a closed form or a published number.  It judges their difference d by a
norm:

    relative                 d = (a - b) / b
    absolute                 d = a - b
    wasserstein, supremum    distances of pressure distributions, see `distance`
    l2                       d = ||a - b||_2 / ||b||_2 of a field, over the grid

The scatter of an ensemble enters the verdict.  The interval of the mean of n surfaces
is Student's at 95 %.  A gate holds only if the *whole* interval of the difference is
within its band, so an ensemble that is too small to decide does not pass.  Two
ensembles over the same seeds are compared pair by pair.  A single surface has an
interval of width 0.

A corrected area, a stiffness and a conductance are estimates of a limit with a claimed
error, which widens the interval as well, so that a gate does not hold if its answers
are less sure than its band is wide.  Of two estimates of the same limit the smaller
claim counts, because the better estimate bounds the error of the other; if both come
from pressures at the same points, they share their error, and the difference of the
claims counts.  A theory and a published number claim no error, so that the claim of the
other side counts.  A closed form shows the true error, and no claim counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, WithJsonSchema

from epcontact.errors import InvalidCase, InvalidScene
from epcontact.files import NAME_PATTERN
from epcontact.results import APART, ContactResult, PressureDistribution, plain

# --- means of ensembles
# --------------------------------------------------------------------------


CONFIDENCE = 0.95

#: A float that is written to JSON as inf, -inf or nan where JSON has no number for it.
Number = Annotated[
    float,
    PlainSerializer(plain, when_used="json"),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"enum": ["inf", "-inf", "nan"]}]}),
]

#: A name in verdict.json from which the path of a file is made.
FileName = Annotated[str, Field(pattern=NAME_PATTERN)]


class Record(BaseModel):
    """A part of verdict.json."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Estimate(Record):
    """A mean over surfaces with its 95 % interval."""

    mean: Number
    half_width: Number = Field(
        alias="half_width_95",
        description="half the width of Student's interval; 0 for one",
    )
    count: int = Field(alias="surfaces", ge=0, description="number of averaged values")
    claimed_error: Number | None = Field(
        default=None, description="that the answers claim"
    )


def estimate(values: Sequence[float]) -> Estimate:
    """Return the mean of independent values with its 95 % interval, of width 0 for one
    value.
    """
    array = np.asarray(values, dtype=float)
    half_width = student_half_width(standard_deviation(values), array.size)
    return Estimate(
        mean=float(array.mean()), half_width_95=half_width, surfaces=array.size
    )


def standard_deviation(values: Sequence[float]) -> float:
    """Return the standard deviation of a single value, estimated from a sample; 0 for
    one.
    """
    array = np.asarray(values, dtype=float)
    return float(array.std(ddof=1)) if array.size > 1 else 0.0


def student_half_width(deviation: float, count: int) -> float:
    """Return half of Student's 95 % interval of a mean of `count` values; 0 for one
    value. `deviation` is the standard deviation of a single value.
    """
    if count == 1:
        return 0.0
    from scipy.special import (
        stdtrit,
    )  # takes longer to load than a solve of one small surface

    factor = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2))
    return factor * deviation / math.sqrt(count)


# --- distances of fields and of distributions
# ----------------------------------------------------


def distance(
    norm: str, a: PressureDistribution, b: PressureDistribution, hardness: float
) -> float:
    """Return the distance of a pressure distribution from another one, the reference.

    "wasserstein" is int |F_a - F_b| dsigma over the hardness (Pa) or, if that is
    infinite, over the mean contact pressure of b, with F the distribution of the
    pressure on the contact.  "supremum" is the largest |F_a - F_b| below the hardness
    over the contact area of b, with F the share of the nominal area at pressures in (0,
    sigma].  The tables are interpolated linearly, so that their pressures should be
    close together.  Raises InvalidCase if there is no contact.
    """
    total_a = float(a.cumulative[-1]) + a.plastic
    total_b = float(b.cumulative[-1]) + b.plastic
    if min(total_a, total_b) <= 0:
        raise InvalidCase(
            "a pressure distribution without contact has no distance to another"
        )
    sigma = np.union1d(a.pressure, b.pressure)
    F_a = np.interp(sigma, a.pressure, a.cumulative)
    F_b = np.interp(sigma, b.pressure, b.cumulative)
    if norm == "supremum":
        return float(np.abs(F_a - F_b).max() / total_b)
    difference = np.abs(F_a / total_a - F_b / total_b)
    scale = hardness if math.isfinite(hardness) else carried_pressure(b) / total_b
    return float(np.trapezoid(difference, sigma) / scale)


def carried_pressure(distribution: PressureDistribution) -> float:
    """Return int sigma dF over the elastic contact, in Pa: its load per nominal
    area.
    """
    sigma, F = distribution.pressure, distribution.cumulative
    return float(np.sum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(F)))


def l2_distance(found: NDArray[Any], exact: NDArray[Any]) -> float:
    """Return ||found - exact||_2/||exact||_2 for two fields on one grid."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


@dataclass(frozen=True)
class Difference:
    """The difference between two answers on the same grid.

    `area` is the relative difference of the raw contact `areas`, `pressure` the L2 norm
    of the difference of the nodal pressures over that of the second, `overlap` the
    number of shared contact nodes over that of nodes in either contact (Jaccard index),
    `wasserstein` the distance of the distributions, and `nodes` the number of nodes
    that are in contact in one answer only.
    """

    area: float
    pressure: float
    overlap: float
    wasserstein: float
    nodes: int
    areas: tuple[float, float]

    def __str__(self) -> str:
        return f"area {self.area:+.2%}, pressure {self.pressure:.1e}"


def difference(
    first: ContactResult, second: ContactResult, hardness: float
) -> Difference:
    """Return the difference of `first` from `second`; the hardness (Pa) scales their
    distance. Raises InvalidScene if their grids differ.
    """
    p, q = first.fields["pressure"], second.fields["pressure"]
    if p.shape != q.shape:
        raise InvalidScene(
            f"pressures on grids of {p.shape} and {q.shape} cannot be compared"
        )
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


# --- gates
# --------------------------------------------------------------------------------------


Norm = Literal["relative", "absolute", "wasserstein", "supremum", "l2"]
#: What a reference is; `verdict.evidence` says it of each gate, and what each means.
Kind = Literal[
    "identity", "closed form", "method here", "other code", "published", "experiment"
]
DISTRIBUTION_NORMS = ("wasserstein", "supremum")

HOLDS: Literal["holds"] = "holds"
FALLS_SHORT: Literal["falls short"] = "falls short"
ERROR: Literal["error"] = "error"


@dataclass(frozen=True)
class Gate:
    """One comparison that must hold: the difference of `of` from `against` is in [low,
    high]. `against` is a method, the name of a closed form, or a number with its
    `source`; `because` is the reason for the width of the band, and `kind` says what a
    number is, see `Kind`.
    """

    quantity: str
    of: str
    against: str | float
    norm: str
    low: float
    high: float
    because: str
    source: str = ""
    kind: str = ""

    @property
    def name(self) -> str:
        """One line for tables and test reports."""
        against = self.against if isinstance(self.against, str) else f"{self.against:g}"
        return f"{self.quantity} of {self.of} against {against} ({self.norm})"


class GateVerdict(Record):
    """One gate, judged: the whole interval of the difference must be within [low,
    high].
    """

    name: str
    status: Literal["holds", "falls short", "error"]
    quantity: str
    of: str
    against: str | float
    norm: str
    low: Number
    high: Number
    because: str
    source: str
    kind: str = Field(
        default="", description="of the reference, such as identity or closed form"
    )
    subject: str = Field(default="", description="what the gate verifies")
    value: Estimate | None = None
    reference: Estimate | None = None
    difference: Estimate | None = None
    grid_error: Number | None = Field(
        default=None,
        description="claimed error of the limits in the difference, which widens its "
        "interval",
    )
    half_width: Number = Field(
        default=0.0,
        description="half the interval that must be in the band: scatter and claim",
    )
    error: str | None = Field(
        default=None, description="why the gate could not be judged"
    )

    @property
    def holds(self) -> bool:
        """True if the gate was judged and held."""
        return self.status == HOLDS

    @property
    def margin(self) -> float:
        """The band over the difference with its interval: 1 or more if it holds; nan if
        unjudged. Both are measured from the middle of the band, which is 0 for a
        distance.
        """
        if self.difference is None:
            return math.nan
        distance = self.norm in (*DISTRIBUTION_NORMS, "l2") and self.low <= 0
        low = -self.high if distance else self.low
        used = abs(self.difference.mean - (low + self.high) / 2) + self.half_width
        return (self.high - low) / 2 / used if used else math.inf

    def __str__(self) -> str:
        """Return one line with the gate, its figures and its reason."""
        if self.value is None or self.reference is None or self.difference is None:
            return f"{self.name}: {self.error}"
        grid = (
            f" (of which {self.grid_error:.2g} is claimed)" if self.grid_error else ""
        )
        return (
            f"{self.name}: difference {self.difference.mean:+.4g} "
            f"± {self.half_width:.2g}{grid} must lie in [{self.low:g}, {self.high:g}] "
            f"({self.value.mean:.6g} against {self.reference.mean:.6g}); because "
            f"{self.because}"
        )


def judge(
    gate: Gate,
    value: Sequence[float],
    reference: Sequence[float],
    paired: bool,
    claim: float | None = None,
) -> GateVerdict:
    """Compare the values of a scalar, one for each surface, with those of its
    reference.  `paired` values come from the same surfaces in the same order; others
    are independent.  `claim` is the claimed error of limits that counts.
    """
    a, b = estimate(value), estimate(reference)
    relative = gate.norm == "relative"
    scale = (abs(b.mean) or math.inf) if relative else 1.0
    if paired:
        pairs = zip(value, reference, strict=True)
        difference = estimate([deviation(gate.norm, *pair) for pair in pairs])
    else:
        # First order: the relative difference is (a - b)/b, so b's width counts times
        # a/b.
        slope = a.mean / scale if relative else 1.0
        half_width = math.hypot(a.half_width, slope * b.half_width) / scale
        mean = deviation(gate.norm, a.mean, b.mean)
        difference = Estimate(mean=mean, half_width_95=half_width, surfaces=0)
    return _judged(gate, a, b, difference, None if claim is None else claim / scale)


def judge_distance(gate: Gate, distances: Sequence[float]) -> GateVerdict:
    """Compare distances, one for each surface, with the gate's band; the reference is
    0.
    """
    difference = estimate(distances)
    return _judged(gate, difference, estimate([0.0]), difference)


def unjudged(gate: Gate, reason: str) -> GateVerdict:
    """Return the verdict on a gate that could not be judged for the given reason."""
    return GateVerdict(**vars(gate), name=gate.name, status=ERROR, error=reason)


def deviation(norm: str, value: float, reference: float) -> float:
    """Return the difference of a value from its reference by the norm relative or
    absolute.
    """
    if norm == "absolute":
        return value - reference
    if reference == 0:
        return 0.0 if value == 0 else math.copysign(math.inf, value)
    return (value - reference) / abs(reference)


def _judged(
    gate: Gate,
    a: Estimate,
    b: Estimate,
    difference: Estimate,
    grid_error: float | None = None,
) -> GateVerdict:
    half = math.hypot(difference.half_width, grid_error or 0.0)
    # NaN compares false, so a difference that is NaN never holds.
    holds = gate.low <= difference.mean - half and difference.mean + half <= gate.high
    figures: Any = {
        "value": a,
        "reference": b,
        "difference": difference,
        "grid_error": grid_error,
    }
    figures |= vars(gate) | {
        "status": HOLDS if holds else FALLS_SHORT,
        "half_width": half,
    }
    return GateVerdict(name=gate.name, **figures)
