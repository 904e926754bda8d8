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


def scene_of(path, shape=(64, 96), body=None, hardness=HARDNESS, poisson_ratio=0.3):
    """Return a capped rough scene with E = 1 whose load path is multiples of PEAK.

    `path` holds the multiples, `shape` the points on the periods 1 and 1.5, and
    `hardness` is in units of E.
    """
    periods = (1.0, 1.5)[: len(shape)]
    surface = SelfAffine(SPECTRUM, periods, shape, seed=12).build()
    material = Material(1.0, poisson_ratio, hardness=hardness)
    load = Load(tuple(PEAK * multiple for multiple in path))
    return Scene(surface, material, load, body or Body())


def flow_of(scene):
    """Return the plastic displacement after the last load of a scene, an array (nx,
    ny).
    """
    return bem.solve(scene).fields["plastic_displacement"]


def plastic_works(steps):
    """Return the plastic work of each load step (energy per nominal area, J/m^2 in SI
    units).
    """
    return [step.quantities["plastic_work"] for step in steps]


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
    """The pressures of unloading are those of an elastic body whose heights are those
    left behind.

    At the peak load the elastic body has the capped pressures, and below it those of
    the path. `kind` holds arguments of `scene_of`.
    """
    peak = scene_of((1,), **kind)
    heights = peak.surface.heights
    flow = flow_of(peak)
    surface = Surface(heights - flow, peak.surface.periods)
    elastic_material = replace(peak.material, hardness=math.inf)
    left = replace(peak, surface=surface, material=elastic_material)
    rounding = 1e-7 * heights.std()
    for path in ((1,), (1, 0.4), (0.3, 1, 0.7, 0.1)):
        fields = bem.solve(scene_of(path, **kind)).fields
        elastic = bem.solve(replace(left, load=Load(PEAK * path[-1]))).fields
        difference = fields["pressure"] - elastic["pressure"]
        assert np.abs(difference).max() < 1e-6 * peak.material.hardness
        assert np.abs(fields["plastic_displacement"] - flow).max() < rounding
        open_gap = fields["gap"] + fields["plastic_displacement"]
        assert open_gap.min() > -rounding


@SCENES
def test_reloading_is_elastic_up_to_the_old_peak_and_flows_on_beyond_it(kind):
    """Reloading to the old peak changes neither areas nor work; beyond it flow
    continues.

    The results beyond are those of one load, also if the solve continues from given
    flow. `kind` holds arguments of `scene_of`.
    """
    path = (1, 0.2, 0.6, 1, 1.3)
    partial = []
    result = bem.solve(scene_of(path, **kind), on_step=partial.append)
    loads = [one.fields["pressure"].mean() / PEAK for one in partial]
    assert loads == pytest.approx(path, rel=1e-12)
    first, down, up, back, beyond = result.steps
    assert down.areas["raw"].plastic == up.areas["raw"].plastic == 0.0
    assert back.areas["raw"] == first.areas["raw"]
    works = plastic_works(result.steps[:4])
    assert works == pytest.approx([works[0]] * 4, rel=1e-6)
    once = bem.solve(scene_of((1.3,), **kind)).final
    assert beyond.areas["raw"] == once.areas["raw"]
    assert beyond.quantities == pytest.approx(once.quantities, rel=1e-6)
    flow = flow_of(scene_of((1,), **kind))
    continued = bem.solve(scene_of((1.3,), **kind), plastic_displacement=flow).final
    assert continued.quantities == pytest.approx(once.quantities, rel=1e-6)


@pytest.mark.parametrize(
    ("valley", "hardness", "fall"), [(10, 0.1, 0.995), (100, 0.1, 0.99), (0, 1e-5, 0.9)]
)
def test_small_falls_over_deep_valleys_end_all_flow(valley, hardness, fall):
    """A small fall of the load ends all flow, although deep valleys dominate the rms
    height.

    The tolerance for pressures grows with the rms height, and must not be taken for a
    return to the peak load. `valley` is the depth in units of the roughness, `hardness`
    is in units of E, and `fall` is the lower load over the peak load.
    """
    x = np.arange(4096) / 4096
    k = np.arange(1, 256)
    phases = np.random.default_rng(1).uniform(size=k.size)
    waves = np.cos(2 * np.pi * (np.outer(x, k) + phases)) @ k**-1.3 / 30
    surface = Surface(1e-6 * (waves - valley * (abs(x - 0.5) < 0.1)), (1.0,))
    load = 0.3 * hardness
    peak = Scene(surface, Material(1e6, 0.0, hardness=hardness), Load(load))
    path = bem.solve(replace(peak, load=Load((load, load * fall))))
    lower = replace(peak, load=Load(load * fall))
    continued = bem.solve(lower, plastic_displacement=flow_of(peak))
    for result in (path, continued):
        pressure = result.fields["pressure"]
        assert result.final.areas["raw"].plastic == pressure.min() == 0.0
        assert pressure.max() < (0.9 + 0.1 * fall) * hardness


def test_points_that_err_alike_are_back_at_the_peak():
    """Equal bumps of a soft metal, loaded again to the peak, have the areas of the
    peak.

    All their pressures are off by more than a residual allows one of them.
    """
    wave = np.cos(8 * math.pi * np.arange(64) / 64)
    surface = Surface(1e-5 * (wave[:, None] + wave), (1e-3, 1e-3))
    load = Load((2e5, 1e5, 2e5))
    scene = Scene(surface, Material(1e11, 0.3, hardness=1e7), load)
    first, down, back = bem.solve(scene).steps
    assert back.areas["raw"] == first.areas["raw"]
    assert first.areas["raw"].plastic > down.areas["raw"].plastic == 0


def test_a_zone_that_no_point_shows_is_plastic_at_the_peak_alone():
    """Edges of pits hide plastic zones that are counted at the peak load,
    not below it.
    """
    pits = np.random.default_rng(3).random((32, 32)) < 0.1
    surface = Surface(-1e-5 * pits, (1e-3, 1e-3))
    load = Load((5e6, 2e6, 5e6))
    result = bem.solve(Scene(surface, Material(1e12, 0.3, hardness=1e7), load))
    first, down, back = result.steps
    assert not result.fields["plastic_displacement"].any()
    assert first.areas["corrected"] == back.areas["corrected"]
    assert first.areas["corrected"].plastic > first.areas["raw"].plastic == 0.0
    assert down.areas["corrected"].plastic == 0.0


def test_a_nearly_rigid_body_is_left_as_the_flat_has_cut_it():
    """A rigid body loses the highest fraction p0/hardness of its surface
    (Abbott-Firestone).
    """
    rigid = Material(1e7, 0.3, hardness=HARDNESS)
    scene = replace(scene_of((1, 0)), material=rigid)
    heights = scene.surface.heights
    from_top = np.sort(heights, axis=None)[::-1]
    cut = round(PEAK / HARDNESS * heights.size)
    rounding = 1e-5 * float(heights.std())
    lowered = flow_of(scene)
    least = np.maximum(heights - from_top[cut - 1], 0)
    most = np.maximum(heights - from_top[cut], 0)
    assert (lowered >= least - rounding).all()
    assert (lowered <= most + rounding).all()
    cycled = replace(scene_of((1, 0.5, 1, 0, 1)), material=rigid)
    works = plastic_works(bem.solve(cycled).steps)
    assert works == pytest.approx([works[0]] * 5, rel=1e-12)


def test_unloading_to_zero_leaves_no_contact_and_costs_no_more_than_the_peak():
    """Each load of unloading takes as many FFT pairs as the peak, and zero load no
    contact.
    """
    result = bem.solve(scene_of((1, 0.8, 0.6, 0.4, 0.2, 0.05, 0)))
    peak, *down, after = result.steps
    most = peak.iterations["fft_pairs"] + 2
    assert all(step.iterations["fft_pairs"] <= most for step in down)
    assert after.areas["raw"].total == after.areas["corrected"].total == 0.0
    assert after.quantities["elastic_energy"] == 0.0
    assert after.quantities["largest_pressure"] == 0.0
    works = plastic_works((peak, after))
    assert works[1] == pytest.approx(works[0])
    open_gap = result.fields["gap"] + result.fields["plastic_displacement"]
    assert open_gap.min() == pytest.approx(0.0, abs=1e-15)
