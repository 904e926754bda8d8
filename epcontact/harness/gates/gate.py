"""Gates: comparisons of two answers, or of an answer with a reference.

A gate compares one quantity a of a method with the reference b: the same quantity of another
method, a closed form or a published number.  It judges their difference d by a norm:

    relative                 d = (a - b) / b
    absolute                 d = a - b
    wasserstein, supremum    distances of pressure distributions, see `distances.distance`
    l2                       d = ||a - b||_2 / ||b||_2 of a field, over the grid

The scatter of an ensemble enters the verdict.  The interval of the mean of n surfaces is
Student's at 95 %.  A gate holds only if the *whole* interval of the difference is within its
band, so an ensemble that is too small to decide does not pass.  Two ensembles over the same seeds
are compared pair by pair.  A single surface has an interval of width 0.

A corrected area is an estimate with a claimed error, which widens the interval as well, so that a
gate does not hold if its answers are less sure than its band is wide.  Of two estimates of the same
area the smaller claim counts, because the better estimate bounds the error of the other.  A theory
and a published number claim no error, so that the claim of the other side counts.  A closed form
shows the true error, and no claim counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from epcontact.harness.gates.statistics import Estimate, Number, Record, estimate

Norm = Literal["relative", "absolute", "wasserstein", "supremum", "l2"]
DISTRIBUTION_NORMS = ("wasserstein", "supremum")

HOLDS: Literal["holds"] = "holds"
FALLS_SHORT: Literal["falls short"] = "falls short"
ERROR: Literal["error"] = "error"


@dataclass(frozen=True)
class Gate:
    """One comparison that must hold: the difference of `of` from `against` is in [low, high].

    `against` is a method, the name of a closed form, or a number with its `source`; `because` is
    the reason for the width of the band.
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


class GateVerdict(Record):
    """One gate, judged: the whole interval of the difference must be within [low, high]."""

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
    value: Estimate | None = None
    reference: Estimate | None = None
    difference: Estimate | None = None
    grid_error: Number | None = Field(
        default=None,
        description="claimed error of the corrected areas in the difference, which widens its "
        "interval",
    )
    error: str | None = Field(default=None, description="why the gate could not be judged")

    @property
    def holds(self) -> bool:
        """True if the gate was judged and held."""
        return self.status == HOLDS

    @property
    def half_width(self) -> float:
        """Half the width of the interval that must be within the band."""
        scatter = 0.0 if self.difference is None else self.difference.half_width
        return math.hypot(scatter, self.grid_error or 0.0)

    @property
    def margin(self) -> float:
        """The band over the difference with its interval: 1 or more if it holds; nan if unjudged.

        Both are measured from the middle of the band, which is 0 for a distance.
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
        grid = f" (of which {self.grid_error:.2g} by the grid)" if self.grid_error else ""
        return (
            f"{self.name}: difference {self.difference.mean:+.4g} "
            f"± {self.half_width:.2g}{grid} must lie in [{self.low:g}, {self.high:g}] "
            f"({self.value.mean:.6g} against {self.reference.mean:.6g}); because {self.because}"
        )


def judge(
    gate: Gate,
    value: Sequence[float],
    reference: Sequence[float],
    paired: bool,
    claim: float | None = None,
) -> GateVerdict:
    """Compare the values of a scalar, one for each surface, with those of its reference.

    `paired` values come from the same surfaces in the same order; others are independent.  `claim`
    is the claimed error of corrected areas that counts.
    """
    a, b = estimate(value), estimate(reference)
    relative = gate.norm == "relative"
    scale = (abs(b.mean) or math.inf) if relative else 1.0
    if paired:
        pairs = zip(value, reference, strict=True)
        difference = estimate([deviation(gate.norm, *pair) for pair in pairs])
    else:
        # First order: the relative difference is (a - b)/b, so b's width counts times a/b.
        slope = a.mean / scale if relative else 1.0
        half_width = math.hypot(a.half_width, slope * b.half_width) / scale
        mean = deviation(gate.norm, a.mean, b.mean)
        difference = Estimate(mean=mean, half_width_95=half_width, surfaces=0)
    return _judged(gate, a, b, difference, None if claim is None else claim / scale)


def judge_distance(gate: Gate, distances: Sequence[float]) -> GateVerdict:
    """Compare distances, one for each surface, with the gate's band; the reference is 0."""
    difference = estimate(distances)
    return _judged(gate, difference, estimate([0.0]), difference)


def unjudged(gate: Gate, reason: str) -> GateVerdict:
    """Return the verdict on a gate that could not be judged for the given reason."""
    return GateVerdict(**vars(gate), name=gate.name, status=ERROR, error=reason)


def deviation(norm: str, value: float, reference: float) -> float:
    """Return the difference of a value from its reference by the norm relative or absolute."""
    if norm == "absolute":
        return value - reference
    if reference == 0:
        return 0.0 if value == 0 else math.copysign(math.inf, value)
    return (value - reference) / abs(reference)


def _judged(
    gate: Gate, a: Estimate, b: Estimate, difference: Estimate, grid_error: float | None = None
) -> GateVerdict:
    figures: Any = {"value": a, "reference": b, "difference": difference, "grid_error": grid_error}
    verdict = GateVerdict(**vars(gate), name=gate.name, status=HOLDS, **figures)
    low, high = difference.mean - verdict.half_width, difference.mean + verdict.half_width
    # NaN compares false, so a difference that is NaN never holds.
    holds = gate.low <= low and high <= gate.high
    return verdict if holds else verdict.model_copy(update={"status": FALLS_SHORT})
