"""Finite elements against boundary elements: the same law on the same body, then the same law on
the half-space."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact import bem
from epcontact.results import ContactResult
from epcontact.scene import Material, Scene


def without_cap(scene: Scene) -> Scene:
    m = scene.material
    return dataclasses.replace(scene, material=Material(m.young_modulus, m.poisson_ratio))


def both(scene: Scene, law: str, *, like_for_like: bool) -> tuple[ContactResult, ContactResult]:
    fem = fem_check.solve(scene, law=law, certified=False)  # type: ignore[arg-type]
    compliance = fem_check.surface_compliance(scene) if like_for_like else None
    return fem, bem.solve(
        scene if law == "capped" else without_cap(scene), compliance=compliance, threads=1
    )


def distance(a: ContactResult, b: ContactResult) -> float:
    p, q = a.fields["pressure"], b.fields["pressure"]
    return float(np.linalg.norm(p - q) / np.linalg.norm(q))


@pytest.mark.parametrize("law", ["elastic", "capped"])
@pytest.mark.parametrize("seed", [7, 8, pytest.param(11, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("nodes", "highest", "dimensions"), [(32, 4, 2), (64, 16, 2), (256, 16, 1)]
)
@pytest.mark.parametrize("pressure", [0.02, 0.2])
def test_on_the_same_body_they_agree_node_by_node(
    law: str, seed: int, nodes: int, highest: int, dimensions: int, pressure: float
) -> None:
    scene = rough_scene(nodes, highest, dimensions=dimensions, seed=seed, pressure=pressure)
    fem, other = both(scene, law, like_for_like=True)
    np.testing.assert_array_equal(fem.fields["state"], other.fields["state"])
    # Both solve to 1e-8; measured 1e-9 to 3e-8.
    assert distance(fem, other) < 1e-6
    rms = scene.surface.heights.std()
    for name in ("gap", "displacement"):
        assert np.abs(fem.fields[name] - other.fields[name]).max() < 1e-6 * rms


def test_the_compliance_given_is_what_makes_them_agree() -> None:
    """Half a per cent on the compliance shows: the gate can fail."""
    scene = rough_scene(32, 4)
    fem = fem_check.solve(scene, law="elastic", certified=False)
    wrong = 1.005 * fem_check.surface_compliance(scene)
    other = bem.solve(without_cap(scene), compliance=wrong, threads=1)
    assert distance(fem, other) > 1e-4


@pytest.mark.parametrize("law", [pytest.param("elastic", marks=pytest.mark.slow), "capped"])
def test_they_converge_to_each_other_on_the_half_space(law: str) -> None:
    grids = np.array([32, 64, 128])
    found = [both(rough_scene(int(n), 4), law, like_for_like=False) for n in grids]
    errors = [distance(*pair) for pair in found]
    order = -np.polyfit(np.log(grids), np.log(errors), 1)[0]
    # First order, by the elements' softness on short waves; measured 1.0 to 1.2.
    assert order > 0.8
    # 32 points a wave.
    assert errors[-1] < 0.025
    fem, other = found[-1]
    areas = fem.final.areas["corrected"].total, other.final.areas["corrected"].total
    assert areas[0] == pytest.approx(areas[1], rel=0.02)


def test_j2_differs_from_the_cap_by_what_the_model_says() -> None:
    """E* xi/sigma_Y = 5, cap at 3 sigma_Y: J2 carries the load on 20 to 50 % more area, and on
    less pressure than the cap; the band is physics, measured on other seeds and grids."""
    scene = rough_scene(48, 6, pressure=0.05, poisson_ratio=0.3)
    j2 = fem_check.solve(scene)
    cap = bem.solve(scene, threads=1, compliance=fem_check.surface_compliance(scene))
    ratio = j2.final.areas["raw"].total / cap.final.areas["raw"].total
    assert 1.15 < ratio < 1.5
    assert j2.fields["pressure"].max() < 0.6
    assert j2.fields["pressure"].mean() == pytest.approx(0.05)
    assert math.isfinite(j2.final.quantities["largest_plastic_strain"])
