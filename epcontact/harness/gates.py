"""Gates: comparisons of two results, or of a result with a reference.

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

A corrected area, a mean gap, a stiffness and a conductance are estimates of a limit
with an error estimate.  It is scaled to 95 % (see `results.factor_to_95`) and widens
the interval as well, so that a gate does not hold if its values are less certain than
its band is wide.  If both sides estimate the same limit, the smaller error estimate
counts, because the better value bounds the error of the other.  If both follow from
pressures at the same points, they share their error, and the difference of the error
estimates counts.  A theory and a published number have no error estimate, so that
the one of the other side counts.  A mean gap is a value on the grid, and its error is
how far the grid is off: two methods on one grid share it, and it does not count between
them.  Against a closed form the true error is seen, and no
error estimate counts.
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

#: Probability that the interval of a mean contains the true mean.
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
        default=None,
        description="error estimate of the mean, as reported by the method",
    )
    error_95: Number | None = Field(
        default=None,
        description="half the width of the 95 % interval of the mean from all errors: "
        "scatter, grid, hardness and treatment",
    )

    @property
    def uncertainty(self) -> float:
        """Half the width of the 95 % interval from all known errors of the mean."""
        return self.half_width if self.error_95 is None else self.error_95


def estimate(values: Sequence[float]) -> Estimate:
    """Return the mean of independent values, in their unit, with its 95 % interval.

    The interval is Student's; for a single value its width is 0.  At least one value is
    needed.
    """
    array = np.asarray(values, dtype=float)
    half_width = student_half_width(standard_deviation(values), array.size)
    return Estimate(
        mean=float(array.mean()), half_width_95=half_width, surfaces=array.size
    )


def standard_deviation(values: Sequence[float]) -> float:
    """Return the standard deviation of a sample, with the divisor n - 1.

    A sample of one value has the standard deviation 0.0.
    """
    array = np.asarray(values, dtype=float)
    return float(array.std(ddof=1)) if array.size > 1 else 0.0


def student_half_width(deviation: float, count: int) -> float:
    """Return half the width of Student's 95 % interval of a mean.

    Args:
        deviation: the standard deviation of the sample; the result has its unit.
        count: the number of values in the mean; for one value the result is 0.0.
    """
    if count == 1:
        return 0.0
    # This import takes longer than a solve of one small surface.
    from scipy.special import stdtrit

    factor = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2))
    return factor * deviation / math.sqrt(count)


# --- distances of fields and of distributions


def distance(
    norm: str, a: PressureDistribution, b: PressureDistribution, hardness: float
) -> float:
    """Return the dimensionless distance of two pressure distributions.

    "wasserstein" is int |F_a - F_b| dsigma over the hardness or, if that is infinite,
    over the mean contact pressure of b.  There F(sigma) is the fraction of the contact
    area at pressures up to sigma.  "supremum" is the largest |F_a - F_b| below the
    hardness, over the contact area of b.  There F(sigma) is the fraction of the nominal
    area at pressures in (0, sigma].  The tables are interpolated linearly, so that
    their pressures should be close together.

    Args:
        norm: "wasserstein" or "supremum".
        a: the distribution that is judged.
        b: the reference.
        hardness: the largest contact pressure, in Pa; infinite: the body is elastic.

    Raises:
        InvalidCase: if one of the distributions has no contact.
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
    """Return the load per nominal area that the elastic contact carries, in Pa.

    It is int sigma dF(sigma) over a table of pressures sigma (Pa) and cumulative
    fractions F of the nominal area, by the trapezoidal rule.
    """
    sigma, F = distribution.pressure, distribution.cumulative
    return float(np.sum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(F)))


def l2_distance(found: NDArray[Any], exact: NDArray[Any]) -> float:
    """Return ||found - exact||_2 / ||exact||_2, dimensionless.

    Both are fields in one unit on one grid, arrays of one shape.  Equal fields have the
    distance 0, also if they are 0; from an exact field of 0 all others are infinitely
    far.
    """
    difference = float(np.linalg.norm(found - exact))
    if difference == 0:
        return 0.0
    scale = float(np.linalg.norm(exact))
    return difference / scale if scale else math.inf


@dataclass(frozen=True)
class Difference:
    """The difference between two results on the same grid.

    Attributes:
        area: relative difference of the raw contact areas from that of the second.
        pressure: L2 norm of the difference of the pressures over that of the second.
        overlap: number of points in both contacts over that of points in either contact
            (Jaccard index).
        wasserstein: distance of the distributions, see `distance`.
        nodes: number of points that are in contact in one of the results only.
        areas: both raw contact areas, as fractions of the nominal area.
    """

    area: float
    pressure: float
    overlap: float
    wasserstein: float
    nodes: int
    areas: tuple[float, float]

    def __str__(self) -> str:
        """Return the differences of area and pressure, such as "area +0.10%, pressure
        1.0e-03".
        """
        return f"area {self.area:+.2%}, pressure {self.pressure:.1e}"


def difference(
    first: ContactResult, second: ContactResult, hardness: float
) -> Difference:
    """Return how far a result is from another one on the same grid.

    Args:
        first: a result with the fields pressure and state, and a distribution.
        second: another one, the reference.
        hardness: the largest contact pressure, in Pa; see `distance`.

    Raises:
        InvalidScene: if the grids differ.
        InvalidCase: if one of the results has no contact.
        KeyError: if one of them has no such field.
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


Norm = Literal["relative", "absolute", "wasserstein", "supremum", "l2"]
#: What a reference is; `verdict.evidence` says it of each gate, and what each means.
Kind = Literal[
    "identity", "closed form", "method here", "other code", "published", "experiment"
]
DISTRIBUTION_NORMS = ("wasserstein", "supremum")

#: A band that begins at this fraction of its upper end, or below, only excludes 0.
_NEARLY_ZERO = 1e-3

HOLDS: Literal["holds"] = "holds"
FALLS_SHORT: Literal["falls short"] = "falls short"
ERROR: Literal["error"] = "error"


@dataclass(frozen=True)
class Gate:
    """One comparison that must hold: a difference must be in the band [low, high].

    Attributes:
        quantity: the name of the quantity that is compared.
        of: the method that is judged.
        against: a method, the name of a closed form, or a number.
        norm: how the difference is measured, see `Norm` and the module.
        low, high: the band, in the unit of the difference.
        because: the reason for the width of the band.
        source: where a number comes from.
        kind: what a number is, see `Kind`; empty: it is not stated.
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
        """The gate in one line, such as "area.total.raw of bem against 0.1 (relative)",
        for tables and test reports.
        """
        against = self.against
        if not isinstance(against, str):
            against = f"{against:g}"
        return f"{self.quantity} of {self.of} against {against} ({self.norm})"

    @property
    def field(self) -> str:
        """The name of the field that is compared, such as "pressure"; only for the norm
        l2.
        """
        return self.quantity.removeprefix("field.")


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
        description="error of the values by the grid, the hardness and the treatment, "
        "at 95 %, which widens the interval of the difference",
    )
    half_width: Number = Field(
        default=0.0,
        description="half the width of the interval that must be in the band, from the "
        "scatter and the error estimate",
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
        """Half the width of the band over the largest difference in the interval.

        The difference is measured from the middle of the band.  The middle is 0 for a
        distance, which has no sign, and for a residual that must be small but not
        exactly 0.  The margin is dimensionless: 1 or more if the gate
        holds, infinite if the difference is exactly in the middle, and NaN if the gate
        could not be judged.
        """
        if self.difference is None:
            return math.nan
        is_distance = self.norm in (*DISTRIBUTION_NORMS, "l2") and self.low <= 0
        begins_at_zero = 0 < self.low < _NEARLY_ZERO * self.high
        is_residual = self.against == 0 and begins_at_zero
        low = -self.high if is_distance or is_residual else self.low
        used = abs(self.difference.mean - (low + self.high) / 2) + self.half_width
        return (self.high - low) / 2 / used if used else math.inf

    def __str__(self) -> str:
        """Return one line: the gate, its difference with interval, its band, the two
        values and the reason of the band; or why the gate could not be judged.
        """
        if self.value is None or self.reference is None or self.difference is None:
            return f"{self.name}: {self.error}"
        grid = ""
        if self.grid_error:
            grid = (
                f" (of which {self.grid_error:.2g} by the grid, hardness or treatment)"
            )
        return (
            f"{self.name}: difference {self.difference.mean:+.4g} "
            f"± {self.half_width:.2g}{grid} must lie in [{self.low:g}, {self.high:g}] "
            f"({self.value.mean:.6g} against {self.reference.mean:.6g}); because "
            f"{self.because}"
        )


def judge_values(
    gate: Gate,
    value: Sequence[float],
    reference: Sequence[float],
    paired: bool,
    error_estimate: float | None = None,
) -> GateVerdict:
    """Return the verdict on a gate whose norm is relative or absolute.

    Args:
        gate: the gate.
        value: the values of the judged method, one for each surface, in the unit of the
            quantity.
        reference: those of the reference, in the same unit.
        paired: whether both belong to the same surfaces in the same order; if not, they
            are independent samples.
        error_estimate: the error of the values' limit that widens the interval, in the
            same unit; None: there is none.

    Raises:
        ValueError: if paired values are not equal in number.
    """
    a = estimate(value)
    b = estimate(reference)
    relative = gate.norm == "relative"
    scale = 1.0
    if relative:
        scale = abs(b.mean) or math.inf
    if paired:
        pairs = zip(value, reference, strict=True)
        difference = estimate([deviation(gate.norm, *pair) for pair in pairs])
    else:
        # To first order, d = (a - b)/b changes by a/b times the relative change of b.
        slope = a.mean / scale if relative else 1.0
        half_width = math.hypot(a.half_width, slope * b.half_width) / scale
        mean = deviation(gate.norm, a.mean, b.mean)
        difference = Estimate(mean=mean, half_width_95=half_width, surfaces=0)
    if error_estimate is None:
        return _verdict_on_difference(gate, a, b, difference)
    return _verdict_on_difference(gate, a, b, difference, error_estimate / scale)


def judge_distance(gate: Gate, distances: Sequence[float]) -> GateVerdict:
    """Return the verdict on a gate whose difference is a distance.

    Args:
        gate: the gate, with the norm wasserstein, supremum or l2.
        distances: from the reference, one for each surface, dimensionless.
    """
    difference = estimate(distances)
    return _verdict_on_difference(gate, difference, estimate([0.0]), difference)


def unjudged_verdict(gate: Gate, reason: str) -> GateVerdict:
    """Return the verdict "error" on a gate that could not be judged.

    `reason` is the sentence that says why.
    """
    return GateVerdict(**vars(gate), name=gate.name, status=ERROR, error=reason)


def deviation(norm: str, value: float, reference: float) -> float:
    """Return the difference of a value from its reference.

    Args:
        norm: "absolute", for value - reference in the unit of both; or "relative", for
            this difference over |reference|.
        value, reference: two numbers in one unit.

    If the reference is 0, the relative difference is 0 for a value of 0 and else
    infinite, with the sign of the value.
    """
    if norm == "absolute":
        return value - reference
    if reference == 0:
        return 0.0 if value == 0 else math.copysign(math.inf, value)
    return (value - reference) / abs(reference)


def _verdict_on_difference(
    gate: Gate,
    a: Estimate,
    b: Estimate,
    difference: Estimate,
    grid_error: float | None = None,
) -> GateVerdict:
    """Return the verdict on a gate whose difference is known.

    The gate holds if the complete interval of the difference is in its band.

    Args:
        gate: the gate.
        a: the mean of the judged values over the surfaces.
        b: the mean of the reference.
        difference: their difference by the norm of the gate, with its interval.
        grid_error: the error of the grid by the same norm, which is added to the half
            width of the interval in quadrature; None: there is none.
    """
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
