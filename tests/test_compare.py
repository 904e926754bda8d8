"""Norms, intervals and verdicts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from epcontact.errors import InvalidCase
from epcontact.harness.gates.distances import distance
from epcontact.harness.gates.gate import Gate, judge, judge_distance
from epcontact.harness.gates.statistics import estimate
from epcontact.harness.quantities.registry import read_quantity
from epcontact.results import Areas, ContactResult, LoadStep, PressureDistribution, Provenance


def gate(norm: str = "relative", low: float = -0.1, high: float = 0.1) -> Gate:
    return Gate("area.total.raw", "bem", "persson", norm, low, high, "a test")


def uniform(low: float, high: float, area: float = 1.0) -> PressureDistribution:
    sigma = np.linspace(0, 2, 2001)
    return PressureDistribution(sigma, area * np.clip((sigma - low) / (high - low), 0, 1))


@pytest.mark.parametrize("count", [2, 3, 4, 5, 64, 1001])
def test_interval_is_students(count: int) -> None:
    values = np.random.default_rng(count).normal(1.0, 0.2, count)
    reference = ttest_1samp(values, 0).confidence_interval(0.95)
    found = estimate(values)
    assert (found.low, found.high) == pytest.approx(tuple(reference), rel=1e-12)


def test_one_value_is_taken_at_its_word() -> None:
    assert estimate([3.0]).half_width == 0


def test_shift_is_its_wasserstein_distance() -> None:
    # Two uniform distributions a shift apart are that shift apart; divided by the hardness 4.
    found = distance("wasserstein", uniform(0.2, 1.2), uniform(0.5, 1.5), 4.0)
    assert found == pytest.approx(0.3 / 4, rel=1e-6)


def test_wasserstein_without_hardness_is_scaled_by_the_mean_pressure() -> None:
    found = distance("wasserstein", uniform(0.2, 1.2), uniform(0.5, 1.5), math.inf)
    assert found == pytest.approx(0.3 / 1.0, rel=1e-6)


def test_supremum_sees_areas_and_wasserstein_does_not() -> None:
    a, b = uniform(0, 1, area=0.5), uniform(0, 1, area=1.0)
    assert distance("supremum", a, b, 4.0) == pytest.approx(0.5)
    assert distance("wasserstein", a, b, 4.0) == pytest.approx(0, abs=1e-12)


def test_plastic_share_moves_the_wasserstein_distance() -> None:
    # Half the contact at the hardness 2 instead of uniform in (0, 1): mean distance 0.5 * 1.5.
    a = PressureDistribution(np.linspace(0, 2, 2001), 0.5 * np.clip(np.linspace(0, 2, 2001), 0, 1))
    plastic = PressureDistribution(a.pressure, a.cumulative, plastic=0.5)
    found = distance("wasserstein", plastic, uniform(0, 1), 2.0)
    assert found == pytest.approx(0.5 * 1.5 / 2, rel=1e-3)


def test_distribution_without_contact_has_no_distance() -> None:
    with pytest.raises(InvalidCase, match="without contact"):
        distance("supremum", uniform(0, 1, area=0.0), uniform(0, 1), 1.0)


def test_gate_holds_only_if_the_whole_interval_does() -> None:
    assert judge(gate(), [1.09], [1.0], paired=False).holds
    assert not judge(gate(), [1.11], [1.0], paired=False).holds
    # The mean is well inside, the interval is not: too few surfaces to tell.
    assert not judge(gate(), [0.9, 1.1], [1.0], paired=False).holds
    assert judge(gate(), [0.98, 1.02, 0.99, 1.01], [1.0], paired=False).holds


def test_pairs_cancel_what_their_surfaces_share() -> None:
    values, references = [1.0, 2.0, 3.0], [1.01, 2.02, 3.03]
    assert judge(gate(), values, references, paired=True).holds
    assert not judge(gate(), values, references, paired=False).holds


def test_interval_of_the_reference_counts() -> None:
    exact = judge(gate(), [1.0], [1.0], paired=False)
    scattered = judge(gate(), [1.0], [0.9, 1.1], paired=False)
    assert exact.holds
    assert not scattered.holds


def test_one_sided_band() -> None:
    finding = gate(low=0.07, high=0.12)
    assert judge(finding, [1.1], [1.0], paired=False).holds
    assert not judge(finding, [1.0], [1.0], paired=False).holds


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_never_holds(value: float) -> None:
    assert not judge(gate(), [value], [1.0], paired=False).holds
    assert not judge_distance(gate("supremum", 0, 1), [value]).holds


def test_unknown_quantity_is_named_with_the_known_ones() -> None:
    step = LoadStep(1.0, {"raw": Areas(0.1, 0.1, 0.0)})
    result = ContactResult("bem", (step,), Provenance("digest"))
    assert read_quantity(result, "area.total.raw") == 0.1
    with pytest.raises(InvalidCase, match=r"area\.total\.raw"):
        read_quantity(result, "area.total.rwa")
