"""Paths of a capped contact that go down and up again: what the flow leaves behind."""

import math
from dataclasses import replace

import numpy as np
import pytest

from epcontact import Body, Load, Material, Scene, SelfAffineSpectrum, Surface, bem
from epcontact.surfaces import SelfAffine

SPECTRUM = SelfAffineSpectrum(
    0.8, 2 * math.pi, 8 * math.pi, 32 * math.pi, rms_slope=0.1
)
HARDNESS = 0.03
PEAK = 0.005


def scene_of(shares, shape=(64, 96), body=None, hardness=HARDNESS, poisson_ratio=0.3):
    """A scene whose load goes through shares of PEAK."""
    surface = SelfAffine(SPECTRUM, (1.0, 1.5)[: len(shape)], shape, seed=12).build()
    material = Material(1.0, poisson_ratio, hardness=hardness)
    return Scene(
        surface, material, Load(tuple(PEAK * s for s in shares)), body or Body()
    )


SCENES = pytest.mark.parametrize(
    "kind",
    [
        {},
        {"shape": (128,)},
        {"body": Body("bonded_layer", 0.1), "poisson_ratio": 0.45},
        {"body": Body("sliding_layer", 0.3)},
        {"hardness": 0.01},
    ],
)


@SCENES
def test_the_elastic_contact_of_the_surface_left_behind_is_the_unloading_branch(kind):
    """At the peak it has the capped pressures, and below the peak those of the path."""
    peak = scene_of((1,), **kind)
    heights, hardness = peak.surface.heights, peak.material.hardness
    flow = bem.solve(peak).fields["plastic_displacement"]
    left = replace(
        peak,
        surface=Surface(heights - flow, peak.surface.periods),
        material=replace(peak.material, hardness=math.inf),
    )
    for shares in ((1,), (1, 0.4), (0.3, 1, 0.7, 0.1)):
        fields = bem.solve(scene_of(shares, **kind)).fields
        elastic = bem.solve(replace(left, load=Load(PEAK * shares[-1]))).fields[
            "pressure"
        ]
        assert np.abs(fields["pressure"] - elastic).max() < 1e-6 * hardness
        assert (
            np.abs(fields["plastic_displacement"] - flow).max() < 1e-7 * heights.std()
        )
        assert (
            fields["gap"] + fields["plastic_displacement"]
        ).min() > -1e-7 * heights.std()


@SCENES
def test_reloading_is_elastic_up_to_the_old_peak_and_flows_on_beyond_it(kind):
    shares, made = np.array([1, 0.2, 0.6, 1, 1.3]), []
    result = bem.solve(scene_of(shares, **kind), on_step=made.append)
    assert [s.fields["pressure"].mean() / PEAK for s in made] == pytest.approx(
        shares, rel=1e-12
    )
    first, down, part, again, beyond = result.steps
    once = bem.solve(scene_of((1.3,), **kind))
    flow = bem.solve(scene_of((1,), **kind)).fields["plastic_displacement"]
    continued = bem.solve(scene_of((1.3,), **kind), plastic_displacement=flow).final
    assert continued.quantities == pytest.approx(once.final.quantities, rel=1e-6)
    assert again.areas["raw"] == first.areas["raw"]
    works = [step.quantities["plastic_work"] for step in (first, down, part, again)]
    assert works == pytest.approx([works[0]] * 4, rel=1e-6)
    assert down.areas["raw"].plastic == part.areas["raw"].plastic == 0.0
    assert beyond.areas["raw"] == once.final.areas["raw"]
    assert beyond.quantities == pytest.approx(once.final.quantities, rel=1e-6)


@pytest.mark.parametrize("kind", [(10, 0.1, 0.995), (100, 0.1, 0.99), (0, 1e-5, 0.9)])
def test_small_falls_over_deep_valleys_end_all_flow(kind):
    """The error that the rms height allows a pressure once was taken for a return to
    the peak.
    """
    valley, hardness, share = kind
    x, k = np.arange(4096) / 4096, np.arange(1, 256)
    phases = np.random.default_rng(1).uniform(size=k.size)
    heights = np.cos(2 * np.pi * (np.outer(x, k) + phases)) @ k**-1.3 / 30
    surface = Surface(1e-6 * (heights - valley * (abs(x - 0.5) < 0.1)), (1.0,))
    up, down = Load(0.3 * hardness), Load(0.3 * hardness * share)
    peak = Scene(surface, Material(1e6, 0.0, hardness=hardness), up)
    flow = bem.solve(peak).fields["plastic_displacement"]
    path = bem.solve(replace(peak, load=Load((up.final, down.final))))
    for result in (
        path,
        bem.solve(replace(peak, load=down), plastic_displacement=flow),
    ):
        assert (
            result.final.areas["raw"].plastic == result.fields["pressure"].min() == 0.0
        )
        assert result.fields["pressure"].max() < (0.9 + 0.1 * share) * hardness


def test_points_that_err_alike_are_back_at_the_peak():
    """On equal bumps of a soft metal pressures err by more than a residual allows one
    of them.
    """
    wave = np.cos(8 * math.pi * np.arange(64) / 64)
    surface = Surface(1e-5 * (wave[:, None] + wave), (1e-3, 1e-3))
    material, loads = Material(1e11, 0.3, hardness=1e7), Load((2e5, 1e5, 2e5))
    first, down, again = bem.solve(Scene(surface, material, loads)).steps
    assert again.areas["raw"] == first.areas["raw"]
    assert first.areas["raw"].plastic > down.areas["raw"].plastic == 0


def test_a_zone_that_no_point_shows_is_plastic_at_the_peak_alone():
    pits = np.random.default_rng(3).random((32, 32)) < 0.1
    surface, material = (
        Surface(-1e-5 * pits, (1e-3, 1e-3)),
        Material(1e12, 0.3, hardness=1e7),
    )
    result = bem.solve(Scene(surface, material, Load((5e6, 2e6, 5e6))))
    (first, down, again), flow = result.steps, result.fields["plastic_displacement"]
    assert not flow.any()
    assert first.areas["corrected"] == again.areas["corrected"]
    assert first.areas["corrected"].plastic > first.areas["raw"].plastic == 0.0
    assert down.areas["corrected"].plastic == 0.0


def test_a_nearly_rigid_body_is_left_as_the_flat_has_cut_it():
    """Without elasticity the highest p0/hardness of the surface is cut off
    (Abbott-Firestone).
    """
    scene = replace(scene_of((1, 0)), material=Material(1e7, 0.3, hardness=HARDNESS))
    cycled = replace(scene, load=Load((PEAK, PEAK / 2, PEAK, 0.0, PEAK)))
    heights = np.sort(scene.surface.heights, axis=None)[::-1]
    cut, rounding = round(PEAK / HARDNESS * heights.size), 1e-5 * float(heights.std())
    lowered = bem.solve(scene).fields["plastic_displacement"]
    assert (
        lowered >= np.maximum(scene.surface.heights - heights[cut - 1], 0) - rounding
    ).all()
    assert (
        lowered <= np.maximum(scene.surface.heights - heights[cut], 0) + rounding
    ).all()
    works = [step.quantities["plastic_work"] for step in bem.solve(cycled).steps]
    assert works == pytest.approx([works[0]] * 5, rel=1e-12)


def test_unloading_to_zero_leaves_no_contact_and_costs_no_more_than_the_peak():
    result = bem.solve(scene_of((1, 0.8, 0.6, 0.4, 0.2, 0.05, 0)))
    peak, *down, after = result.steps
    pairs = peak.iterations["fft_pairs"] + 2
    assert all(step.iterations["fft_pairs"] <= pairs for step in down)
    assert after.areas["raw"].total == after.areas["corrected"].total == 0.0
    assert (
        after.quantities["elastic_energy"]
        == after.quantities["largest_pressure"]
        == 0.0
    )
    assert after.quantities["plastic_work"] == pytest.approx(
        peak.quantities["plastic_work"]
    )
    open_gap = result.fields["gap"] + result.fields["plastic_displacement"]
    assert open_gap.min() == pytest.approx(0.0, abs=1e-15)
