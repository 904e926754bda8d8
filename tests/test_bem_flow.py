"""Paths of a capped contact that go down and up again: what the flow leaves behind."""

import math
from dataclasses import replace

import numpy as np
import pytest

from epcontact import (
    Body,
    ContactResult,
    Load,
    Material,
    Scene,
    SelfAffineSpectrum,
    Surface,
    bem,
)
from epcontact.surfaces import SelfAffine

SPECTRUM = SelfAffineSpectrum(0.8, 2 * math.pi, 8 * math.pi, 32 * math.pi, rms_slope=0.1)
HARDNESS = 0.03
PEAK = 0.005


def scene_of(
    path: tuple[float, ...],
    shape: tuple[int, ...] = (64, 96),
    body: Body | None = None,
    hardness: float = HARDNESS,
    poisson_ratio: float = 0.3,
) -> Scene:
    surface = SelfAffine(SPECTRUM, (1.0, 1.5)[: len(shape)], shape, seed=12).build()
    material = Material(1.0, poisson_ratio, hardness=hardness)
    return Scene(surface, material, Load(path), body or Body())


def left(scene: Scene, result: ContactResult) -> Scene:
    """The elastic scene on the surface that a result has left behind."""
    heights = scene.surface.heights - result.fields["plastic_displacement"]
    surface = Surface(heights, scene.surface.periods)
    return replace(scene, surface=surface, material=replace(scene.material, hardness=math.inf))


SCENES = pytest.mark.parametrize(
    "kind",
    [
        {},
        {"shape": (128,)},
        {"body": Body("bonded_layer", 0.1), "poisson_ratio": 0.45},
        {"body": Body("sliding_layer", 0.3)},
        {"hardness": 0.01},
    ],
    ids=["grid", "line", "bonded", "sliding", "soft"],
)


@SCENES
def test_the_elastic_contact_of_the_surface_left_behind_is_the_unloading_branch(kind) -> None:
    """At the peak it has the capped pressures, and below the peak those of the path."""
    peak = scene_of((PEAK,), **kind)
    loaded = bem.solve(peak)
    for path in ((PEAK,), (PEAK, 0.4 * PEAK), (0.3 * PEAK, PEAK, 0.7 * PEAK, 0.1 * PEAK)):
        result = bem.solve(replace(peak, load=Load(path)))
        elastic = bem.solve(replace(left(peak, loaded), load=Load(path[-1])))
        hardness = peak.material.hardness
        difference = np.abs(result.fields["pressure"] - elastic.fields["pressure"]).max()
        assert difference < 1e-6 * hardness
        np.testing.assert_allclose(
            result.fields["plastic_displacement"],
            loaded.fields["plastic_displacement"],
            atol=1e-8 * float(peak.surface.heights.std()),
        )
        open_gap = result.fields["gap"] + result.fields["plastic_displacement"]
        assert open_gap.min() > -1e-7 * float(peak.surface.heights.std())
        assert result.final.quantities["mean_gap"] == pytest.approx(
            elastic.final.quantities["mean_gap"], rel=1e-7
        )


@SCENES
def test_reloading_is_elastic_up_to_the_old_peak_and_flows_on_beyond_it(kind) -> None:
    path = tuple(PEAK * share for share in (1, 0.2, 0.6, 1, 1.3))
    result = bem.solve(scene_of(path, **kind))
    first, down, part, again, beyond = result.steps
    once = bem.solve(scene_of(path[-1:], **kind))
    assert again.areas["raw"] == first.areas["raw"]
    assert again.areas["corrected"].plastic == pytest.approx(
        first.areas["corrected"].plastic, rel=1e-6
    )
    works = [step.quantities["plastic_work"] for step in (first, down, part, again)]
    assert works == pytest.approx([works[0]] * 4, rel=1e-6)
    assert down.areas["raw"].plastic == part.areas["raw"].plastic == 0.0
    assert beyond.areas["raw"] == once.final.areas["raw"]
    for name in ("mean_gap", "mean_plastic_displacement", "mean_separation", "elastic_energy"):
        value = once.final.quantities[name]
        assert beyond.quantities[name] == pytest.approx(value, rel=1e-6)
    for name in ("pressure", "gap", "plastic_displacement"):
        scale = np.abs(once.fields[name]).max()
        np.testing.assert_allclose(result.fields[name], once.fields[name], atol=2e-6 * scale)


def test_unloading_keeps_more_contact_than_loading_had() -> None:
    path = tuple(PEAK * share for share in (0.05, 0.2, 0.5, 1, 0.5, 0.2, 0.05))
    areas = [step.areas["corrected"].total for step in bem.solve(scene_of(path)).steps]
    ratios = [down / up for down, up in zip(areas[:3:-1], areas[:3], strict=True)]
    assert 1.2 < ratios[2] < ratios[1] < ratios[0] < 5


def test_a_path_is_continued_from_the_plastic_displacement_of_a_result() -> None:
    path = (PEAK, 0.3 * PEAK, 1.2 * PEAK)
    whole = bem.solve(scene_of(path))
    first = bem.solve(scene_of(path[:2]))
    rest = bem.solve(scene_of(path[2:]), plastic_displacement=first.fields["plastic_displacement"])
    np.testing.assert_allclose(
        rest.fields["pressure"], whole.fields["pressure"], atol=1e-6 * HARDNESS
    )
    assert rest.final.quantities == pytest.approx(whole.final.quantities, rel=1e-6)


def test_the_work_of_the_load_is_stored_or_spent_on_flow() -> None:
    """int p d(approach) = U_el + hardness w by the trapezoidal rule: second order, both ways."""

    def missing(steps: int) -> tuple[float, float]:
        up = np.linspace(0.4, 1, steps + 1)
        down = np.linspace(1, 0.3, steps + 1)[1:]
        result = bem.solve(scene_of(tuple(PEAK * np.concatenate([up, down]))))
        p = np.array([step.mean_pressure for step in result.steps])
        s = np.array([step.quantities["mean_separation"] for step in result.steps])
        stored = np.array([step.quantities["elastic_energy"] for step in result.steps])
        spent = np.array([step.quantities["plastic_work"] for step in result.steps])
        work = -np.cumsum((p[1:] + p[:-1]) / 2 * np.diff(s))
        balance = work - np.diff(stored + spent).cumsum()
        return balance[steps - 1] / work[steps - 1], (balance[-1] - balance[steps - 1]) / work[-1]

    coarse, fine = np.abs(missing(4)), np.abs(missing(8))
    assert fine.max() < 0.002
    assert (fine < 0.35 * coarse).all()


def test_a_nearly_rigid_body_is_left_as_the_flat_has_cut_it() -> None:
    """Without elasticity the highest p0/hardness of the surface is cut off (Abbott-Firestone)."""
    scene = scene_of((PEAK, 0.0))
    stiff = replace(scene, material=Material(1e7, 0.3, hardness=HARDNESS))
    result = bem.solve(stiff)
    heights = np.sort(scene.surface.heights, axis=None)[::-1]
    cut = round(PEAK / HARDNESS * heights.size)
    lowered, rounding = result.fields["plastic_displacement"], 1e-5 * float(heights.std())
    assert (lowered >= np.maximum(scene.surface.heights - heights[cut - 1], 0) - rounding).all()
    assert (lowered <= np.maximum(scene.surface.heights - heights[cut], 0) + rounding).all()
    assert heights[cut - 1] - heights[cut] < 2e-3 * heights.std()


def test_unloading_to_zero_leaves_no_contact_and_the_flow() -> None:
    result = bem.solve(scene_of((PEAK, 0.0)))
    loaded, after = result.steps
    assert after.areas["raw"].total == after.areas["corrected"].total == 0.0
    assert after.quantities["elastic_energy"] == after.quantities["largest_pressure"] == 0.0
    assert after.quantities["plastic_work"] == pytest.approx(loaded.quantities["plastic_work"])
    assert not result.fields["pressure"].any()
    open_gap = result.fields["gap"] + result.fields["plastic_displacement"]
    assert open_gap.min() == pytest.approx(0.0, abs=1e-15)


def test_a_load_on_the_way_down_costs_no_more_than_the_peak_did() -> None:
    path = tuple(PEAK * share for share in (1, 0.8, 0.6, 0.4, 0.2, 0.05))
    pairs = [step.iterations["fft_pairs"] for step in bem.solve(scene_of(path)).steps]
    assert max(pairs[1:]) <= pairs[0] + 2
