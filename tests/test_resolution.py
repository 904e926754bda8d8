"""The error of areas on grids that do not resolve the waves of a surface."""

import math

import numpy as np
import pytest
from laboratory import sharp_kinds

from epcontact import bem
from epcontact.bem.resolution import every_second_point, unresolved_weight
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.studies.paper_scene import self_affine
from epcontact.surfaces import HeightsFromArray

pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

N = 48
X = np.arange(N) / N
#: Arcs of a cutter, 6 points each, with cusps between them.
CUSPS = ((8 * X[:, None] + X) % 1 - 0.5) ** 2 / 16
#: Roughness of Hurst exponent .8 with four points a wave.
GENERATED = self_affine(2 * math.pi, (N, N), 3, N / 4, 2.0)
ROUGH = GENERATED.heights
MATERIAL = Material(1.0, 0.0, hardness=0.4)


def solved(surface, *loads, **options):
    """Return the load steps of a surface under mean pressures over E*."""
    scene = Scene(surface, MATERIAL, Load(loads))
    return bem.solve(scene, threads=1, **options).steps


def plain(heights, sampled=None):
    """Return a surface of heights (n, n) or (n,) on a period of 1."""
    return Surface(heights, (1.0,) * heights.ndim, sampled=sampled)


@pytest.mark.parametrize(
    ("heights", "expected"),
    [(ROUGH, 0.0), (CUSPS, 1.0), (CUSPS[:, 0], 1.0), (np.zeros((N, N)), 0.0)],
)
def test_a_spectrum_up_to_the_shortest_wave_is_not_resolved(heights, expected):
    """Cusps count completely, on a line too; roughness of four points a wave, and the
    same with its mirror images, do not count; nor do surfaces of a formula.
    """
    assert unresolved_weight(plain(heights)) == expected
    assert unresolved_weight(plain(heights, sampled=False)) == 0.0
    if heights.ndim == 2:
        recipe = HeightsFromArray(heights, (1.0, 1.0), "mirrored", clipped="keep")
        assert unresolved_weight(recipe.build()) == expected


def test_heights_are_samples_unless_a_recipe_makes_them():
    """Maps and bare arrays are samples; generated and alternative heights are not."""
    assert plain(ROUGH).sampled
    assert HeightsFromArray(CUSPS, (1.0, 1.0), "periodic").build().sampled
    tilted = HeightsFromArray(CUSPS + X, (1.0, 1.0), "mirrored").build()
    assert tilted.sampled
    assert not tilted.alternatives[0].applied_to(tilted).sampled
    assert not GENERATED.sampled


@pytest.mark.parametrize("size", [N, N - 1])
def test_the_error_has_the_change_at_every_second_point(size):
    """At each load of a path, the change is added in squares to the error by the grid,
    of areas and of the mean gap; the areas themselves do not change.
    """
    heights = CUSPS[:size, :size]
    loads = (0.02, 0.2, 0.05)
    before = solved(plain(heights, sampled=False), *loads)
    coarse, points = every_second_point(plain(heights))
    assert np.array_equal(coarse.heights, heights[points])
    assert coarse.spacing == pytest.approx((2 / size, 2 / size))
    changed = solved(coarse, *loads, area_tolerance=1e-4)
    for now, old, other in zip(
        solved(plain(heights), *loads), before, changed, strict=True
    ):
        assert now.areas["corrected"] == old.areas["corrected"]
        for part in ("total", "elastic", "plastic"):
            areas = [vars(step.areas["corrected"])[part] for step in (old, other)]
            expected = math.hypot(vars(old.areas["error"])[part], areas[1] - areas[0])
            assert vars(now.areas["error"])[part] == pytest.approx(expected, rel=1e-6)
        gaps = [step.quantities["mean_gap"] for step in (old, other)]
        name = "mean_gap_error_by_grid"
        expected = math.hypot(old.quantities[name], gaps[1] - gaps[0])
        assert now.quantities[name] == pytest.approx(expected, rel=1e-6)


def test_a_path_that_goes_on_has_the_same_error():
    """With the flow of an earlier result, the error is near that of an unbroken path,
    whose flow on the coarse grid is its own.
    """
    surface = plain(CUSPS)
    first = bem.solve(Scene(surface, MATERIAL, Load(0.2)), threads=1)
    flow = first.fields["plastic_displacement"]
    *_, expected = solved(surface, 0.2, 0.1, 0.05)
    *_, found = solved(surface, 0.1, 0.05, plastic_displacement=flow)
    assert vars(found.areas["error"]) == pytest.approx(
        vars(expected.areas["error"]), rel=0.25
    )


def test_errors_of_resolved_roughness_stay():
    """Four points a wave are resolved: the error is the same without the comparison."""
    (found,) = solved(plain(ROUGH), 0.1)
    (expected,) = solved(plain(ROUGH, sampled=False), 0.1)
    assert found.areas == expected.areas


def test_areas_of_sharp_kinds_hold():
    """On three kinds, at least 85 % of the areas are within their errors, and fewer
    without unresolved waves.
    """
    kinds = (
        sharp_kinds.bowls,
        sharp_kinds.peened,
        sharp_kinds.overlapping_dents,
    )
    table = sharp_kinds.coverage(kinds, [901])
    assert (table["within now"] >= 85).all()
    assert table["within before"].mean() < 87
