"""The increments of a load path: chosen by their error, in any unit, down to zero and up again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact.results import ContactResult
from epcontact.scene import Load, Material, Scene, Surface
from fem_check import increments


def moved(one: ContactResult, other: ContactResult) -> float:
    """The share of the force that lies on other nodes."""
    p, q = one.fields["pressure"], other.fields["pressure"]
    return float(np.abs(p - q).sum() / q.sum())


@pytest.mark.parametrize("severity", [5.0, pytest.param(50.0, marks=pytest.mark.slow)])
def test_the_increments_are_as_many_as_their_error_asks_for(severity: float) -> None:
    scene = rough_scene(
        16, 2, yield_stress=1 / severity, pressure=0.25 / severity, hardness=math.inf
    )
    fine = fem_check.solve(scene, steps=24, certified=False)
    errors, counts = [], []
    for tolerance in (0.3, 0.006):
        found = fem_check.solve(scene, step_tolerance=tolerance, certified=False)
        errors.append(moved(found, fine))
        counts.append(found.cost["increments"])
        assert found.final.quantities["step_error"] <= tolerance
        assert errors[-1] <= 2 * tolerance  # two pairs' errors; the state forgets earlier ones
    assert counts[1] > counts[0]
    assert errors[1] < errors[0]


def test_an_elastic_material_needs_no_increments() -> None:
    scene = rough_scene(16, 2, yield_stress=1e6)
    found = fem_check.solve(scene, certified=False)
    # The elastic contact is found at once: both halves of the path are whole pairs.
    assert found.final.quantities["step_error"] < 1e-7
    assert found.cost["increments"] == 6


def scaled(length: float, stress: float) -> Scene:
    scene = rough_scene(12, 2, hardness=math.inf)
    heights, m = scene.surface.heights * length, scene.material
    pressures = tuple(p * stress for p in (0.05, 0.01, 0.0))
    return Scene(
        Surface(heights, (length, length)),
        Material(m.young_modulus * stress, m.poisson_ratio, yield_stress=m.yield_stress * stress),
        Load(pressures),
    )


@pytest.mark.parametrize(("length", "stress"), [(1e-9, 1e9), (10.0, 1e9), (1e-3, 1.0)])
def test_the_unit_of_length_does_not_matter(length: float, stress: float) -> None:
    """1 nm to 10 m, on a path that unloads to nothing: the same dimensionless answers."""
    one, other = (fem_check.solve(scaled(*units)) for units in ((1.0, 1.0), (length, stress)))
    for a, b in zip(one.steps, other.steps, strict=True):
        assert a.areas["raw"] == b.areas["raw"]
        assert max(b.residuals.values()) < 1e-7
        for name, unit in (
            ("mean_gap", length),
            ("approach", length),
            ("largest_pressure", stress),
        ):
            expected = a.quantities[name]
            assert b.quantities[name] / unit == pytest.approx(expected, rel=1e-8, abs=1e-8 * 0.01)


def test_unloaded_to_nothing_the_flat_just_touches_and_can_press_again() -> None:
    scene = rough_scene(16, 3, pressure=(0.05, 0.0, 0.05), hardness=math.inf)
    peak, free, again = fem_check.solve(scene, certified=False).steps
    assert free.mean_pressure == 0
    assert free.areas["raw"].total == 0
    assert free.quantities["largest_pressure"] == 0
    # Flattened asperities: the flat touches deeper than at first, and less deep than pressed.
    assert 0 < free.quantities["approach"] < peak.quantities["approach"]
    assert again.areas["raw"].total == pytest.approx(peak.areas["raw"].total, rel=0.05)
    assert again.quantities["mean_gap"] == pytest.approx(peak.quantities["mean_gap"], rel=0.01)
    elastic = fem_check.solve(scene, law="elastic", certified=False).steps
    assert elastic[1].quantities["approach"] == pytest.approx(0, abs=1e-12)
    assert elastic[2].areas == elastic[0].areas


def test_the_shortest_pair_is_kept_and_its_error_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(increments, "SHORTEST", 0.5)
    result = fem_check.solve(rough_scene(16, 2), step_tolerance=1e-9, certified=False)
    assert result.final.quantities["step_error"] > 1e-9
    assert result.cost["increments"] == 6
