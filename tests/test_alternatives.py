"""Errors by the measurement of a surface: removed planes and missing heights."""

import math
from dataclasses import replace

import numpy as np
import pytest
from laboratory import measured_maps

from epcontact import alternatives, bem, persson
from epcontact.alternatives import on_coarser_grid, with_measurement_errors
from epcontact.results import Areas, LoadStep
from epcontact.scene import Alternative, Load, Material, Scene, Surface
from epcontact.surfaces import Facing, HeightsFromArray
from epcontact.surfaces.alternatives import fill_smoothly
from epcontact.surfaces.treatment import find_clipped

pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

N = 64
POSITION = (np.arange(N) + 0.5) / N
#: A period whose least-squares plane is not level.
PERIOD = np.sin(2 * np.pi * POSITION)[:, None] + np.cos(6 * np.pi * POSITION)
ROUGH = measured_maps.period(measured_maps.rolled, N, 5)
MATERIAL = Material(1.0, 0.0, hardness=0.01)


def mirrored(heights, **steps):
    """Return the surface of a map (N, N) with its mirror images; the spacing is 1."""
    return HeightsFromArray(heights, (N, N), "mirrored", **steps).build()


def scene_of(surface, load=1e-3):
    """Return a scene of a surface with MATERIAL at a mean pressure."""
    return Scene(surface, MATERIAL, Load(load))


# --- the removed plane


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_an_alternative_gives_a_period_its_own_plane_back(tilt):
    """The first alternative of a tilted period is the period: its opposite edges meet.

    `tilt` is the slope along x in the unit of the heights over a point.
    """
    surface = mirrored(PERIOD + tilt * np.arange(N)[:, None])
    first, second = surface.alternatives
    assert first.source == second.source == "form"
    found = first.applied_to(surface).heights[:N, :N]
    step = np.ptp(PERIOD, axis=0).max() * np.pi / N  # between neighbours
    assert np.abs(found - PERIOD).max() < step
    assert np.abs(surface.heights[:N, :N] - PERIOD).max() > 5 * step
    # The plane of a sine has a slope of -6/pi over the period.
    plane = 6 / np.pi * (N - 1) / N - 2 * np.sin(np.pi / N)
    assert f"may be off by {plane:.3g} m" in str(surface.notes)


def test_the_second_alternative_has_the_other_sign_along_y():
    """Both alternatives have equal changes along x and opposite changes along y."""
    surface = mirrored(ROUGH)
    changes = [
        a.applied_to(surface).heights - surface.heights for a in surface.alternatives
    ]
    assert changes[0].mean(axis=1) == pytest.approx(changes[1].mean(axis=1))
    assert changes[0].mean(axis=0) == pytest.approx(-changes[1].mean(axis=0))
    for change in changes:
        assert np.array_equal(change, change[::-1, ::-1])  # mirrored, too


def test_a_removed_curvature_is_uncertain_too():
    """With form = 2 the changes have a quadratic term, which form = 1 does not have."""
    rough = measured_maps.period(measured_maps.hurst5, N, 5)
    for form, is_curved in ((1, False), (2, True)):
        surface = mirrored(rough, form=form)
        profile = surface.alternatives[0].changes[0][:N, 0]
        assert (np.abs(np.diff(profile, 2)).max() > 1e-6) == is_curved


def test_curvatures_have_all_signs_along_both_axes():
    """With form = 2 four alternatives have curvatures of all signs, and their size is
    that of the roughness: an estimate from orders 3 and 4 of a known profile.
    """
    x = np.linspace(-1, 1, N)
    profile = np.polynomial.legendre.legval(x, [0, 0, 0, 0.3, -0.4])
    heights = profile[:, None] + np.polynomial.legendre.legval(x, [0, 0, 0, 0.1])
    surface = mirrored(heights, form=2)
    bends = []
    for alternative in surface.alternatives:
        change = alternative.applied_to(surface).heights - surface.heights
        bends.append([np.diff(c[:N], 2).mean() for c in (change[:, 0], change[0])])
    signs = {tuple(np.sign(bend)) for bend in bends}
    assert len(bends) == len(signs) == 4
    # A term c2 of order 2 has the second derivative 3 c2.
    expected = 3 * np.hypot(1.65 * 0.3, 2.34 * 0.4) / np.sqrt(2) * (2 / (N - 1)) ** 2
    assert abs(bends[0][0]) == pytest.approx(expected, rel=0.05)
    line = HeightsFromArray(heights[:, 0], (N,), "mirrored", form=2).build()
    assert len(line.alternatives) == 2


@pytest.mark.parametrize(
    "options",
    [{"form": 0}, {"longest_wavelength": 32.0}],
)
def test_nothing_is_uncertain_where_no_plane_was_removed(options):
    """Without a removed plane, or without long waves, there are no alternatives."""
    assert mirrored(ROUGH, **options).alternatives == ()
    assert HeightsFromArray(ROUGH, (N, N)).build().alternatives == ()


# --- missing heights


def test_a_smooth_filling_rises_above_the_rim_of_a_missing_summit():
    """The smooth filling of a missing summit is at most 5 % off its height.

    The highest point of the rim is 20 % below.  A harmonic function is filled exactly.
    """
    x = np.arange(40) - 20.0
    bump = np.exp(-(x[:, None] ** 2 + x**2) / 100)
    holes = bump > 0.8
    filled = fill_smoothly(np.where(holes, 0.0, bump), holes)
    assert 0.95 < filled.max() < 1.05
    saddle = x[:, None] * np.ones(40)
    inside = np.zeros(holes.shape, bool)
    inside[10:20, 12:30] = True
    found = fill_smoothly(np.where(inside, 0.0, saddle), inside)
    assert found == pytest.approx(saddle, abs=1e-8)


def test_only_heights_in_holes_change():
    """Alternatives of missing heights leave measured points as they are, in a band,
    too, to the precision of a transform.
    """
    holes = np.zeros((N, N), bool)
    holes[20:26, 30:34] = True
    surface = mirrored(np.where(holes, np.nan, ROUGH), missing="nearest", form=0)
    high, low = surface.alternatives
    assert high.source == low.source == "missing"
    for alternative in (high, low):
        moved = alternative.applied_to(surface).heights != surface.heights
        assert moved[:N, :N][holes].all()
        assert not moved[~surface.filled].any()
    band = mirrored(
        np.where(holes, np.nan, ROUGH), missing="nearest", shortest_wavelength=8.0
    )
    change = band.alternatives[-1].applied_to(band).heights - band.heights
    spectrum = np.abs(np.fft.fft2(change))
    assert spectrum[N // 2, N // 2] < 1e-9 * spectrum.max()


def test_two_maps_face_to_face_have_the_alternatives_of_both():
    """A pair of surfaces has the alternatives of the first and of the second."""
    first = HeightsFromArray(ROUGH, (N, N), "mirrored")
    second = HeightsFromArray(ROUGH.T, (N, N), "mirrored")
    assert len(Facing(first, second).build().alternatives) == 4


# --- clipped maps


def test_a_clipped_map_is_detected():
    """Points at the end of the range count as not measured, unless the user keeps them.

    Alternatives of clipped summits are never below the range.
    """
    limit = np.quantile(ROUGH, 0.97)
    clipped = np.minimum(ROUGH, limit)
    with pytest.warns(match="heights are the highest one"):
        surface = mirrored(clipped, form=0)
    assert np.array_equal(surface.filled[:N, :N], clipped >= limit)
    for alternative in surface.alternatives:
        assert (alternative.applied_to(surface).heights >= surface.heights).all()
    kept = mirrored(clipped, form=0, clipped="keep")
    assert kept.filled is None
    assert find_clipped(-clipped, -1).sum() == find_clipped(clipped, 1).sum() > 8
    assert not find_clipped(clipped, -1).any()


@pytest.mark.parametrize("steps", [20, 60, 1000])
def test_heights_in_steps_are_not_clipped(steps):
    """Heights that an instrument rounds to `steps` levels have no plateau at an end."""
    rounded = np.round(ROUGH / np.ptp(ROUGH) * steps)
    assert not find_clipped(rounded, 1).any()
    assert not find_clipped(rounded, -1).any()


def test_marks_and_two_levels_are_not_clipped():
    """A mark far below the map, and a surface of two levels, are not clipped."""
    marked = ROUGH.copy()
    marked[:8] = -9999.0
    assert not find_clipped(marked, -1).any()
    assert not find_clipped(np.repeat([1.0, 0.0], 32)[:, None] * np.ones(64), 1).any()


# --- errors


def test_an_error_is_twice_the_largest_difference():
    """Errors by form are twice the largest difference of the results on alternatives.

    They are a part of the error of each value.
    """
    surface = mirrored(ROUGH + 0.1 * PERIOD)
    row = bem.solve(scene_of(surface)).final.row
    rows = [
        bem.solve(scene_of(a.applied_to(surface))).final.row
        for a in surface.alternatives
    ]
    for name in ("total_area", "plastic_area", "mean_gap"):
        largest = max(abs(other[name] - row[name]) for other in rows)
        assert row[f"{name}_error_by_form"] == pytest.approx(2 * largest, rel=0.05)
        assert row[f"{name}_error"] > row[f"{name}_error_by_form"]


def test_the_theory_solves_its_alternatives():
    """A theory of the surface's spectrum has the errors, too; without holes it has no
    error by missing heights.
    """
    holes = np.quantile(ROUGH, 0.9) < ROUGH
    surface = mirrored(np.where(holes, np.nan, ROUGH), missing="nearest")
    result = persson.solve(scene_of(surface), energy_reduction=1, spectrum="surface")
    row = result.final.row
    assert row["total_area_error_by_missing"] > row["total_area_error_by_form"] > 0
    whole = mirrored(ROUGH)
    result = persson.solve(scene_of(whole), energy_reduction=1, spectrum="surface")
    assert "total_area_error_by_missing" not in result.final.row


@pytest.mark.parametrize("step", [2, 3])
def test_a_large_map_has_its_alternatives_on_fewer_points(monkeypatch, step):
    """A coarser grid has every so many points of the heights, of the mask of filled
    points and of both kinds of alternatives, also where the grid is no multiple.
    """
    holes = np.zeros((N, N), bool)
    holes[20:26, 30:33] = True
    surface = mirrored(np.where(holes, np.nan, ROUGH + 0.1 * PERIOD), missing="nearest")
    assert on_coarser_grid(scene_of(surface)).surface is surface
    monkeypatch.setattr(alternatives, "LARGEST_GRID", surface.heights.size / step**2)
    coarse = on_coarser_grid(scene_of(surface)).surface
    count = math.ceil(2 * N / step)
    assert coarse.shape == (count, count)
    assert coarse.periods == surface.periods
    points = np.arange(count) * 2 * N // count  # every third, but for one of them
    grid = np.ix_(points, points)
    assert np.array_equal(coarse.heights, surface.heights[grid])
    assert np.array_equal(coarse.filled, surface.filled[grid])
    pairs = zip(coarse.alternatives, surface.alternatives, strict=True)
    for found, alternative in pairs:
        assert found.source == alternative.source
        heights = alternative.applied_to(surface).heights[grid]
        assert found.applied_to(coarse).heights == pytest.approx(heights, abs=1e-12)
    line = HeightsFromArray(ROUGH[:, 0], (N,), "mirrored").build()
    monkeypatch.setattr(alternatives, "LARGEST_GRID", N)
    coarse = on_coarser_grid(scene_of(line)).surface
    assert np.array_equal(coarse.heights, line.heights[::2])


def test_errors_on_fewer_points_are_differences_there(monkeypatch):
    """Errors by form on every second point are differences from the result on every
    second point, not from the one on all points, which is reported.

    The error of the mean gap is within a tenth of that on all points.
    """
    surface = mirrored(ROUGH + 0.5 * PERIOD)
    exact = bem.solve(scene_of(surface)).final.row
    monkeypatch.setattr(alternatives, "LARGEST_GRID", surface.heights.size // 4)
    row = bem.solve(scene_of(surface)).final.row
    coarse = on_coarser_grid(scene_of(surface)).surface
    variants = [coarse.annotated(alternatives=())]
    variants += [each.applied_to(coarse) for each in coarse.alternatives]
    rows = [bem.solve(scene_of(variant)).final.row for variant in variants]
    for name in ("mean_gap", "total_area", "plastic_area"):
        assert row[name] == exact[name]
        differences = [abs(other[name] - rows[0][name]) for other in rows[1:]]
        by_hand = 2 * max(differences)
        assert row[f"{name}_error_by_form"] == pytest.approx(by_hand, rel=0.05)
    error = exact["mean_gap_error_by_form"]
    assert row["mean_gap_error_by_form"] == pytest.approx(error, rel=0.1)


def test_no_area_is_claimed_for_missing_summits():
    """Without the highest 5 %, the areas of a light load have an infinite error, with a
    note that says what to measure.
    """
    holes = np.quantile(ROUGH, 0.95) < ROUGH
    surface = mirrored(np.where(holes, np.nan, ROUGH), missing="harmonic")
    result = bem.solve(scene_of(surface, 2e-4))
    assert result.final.row["total_area_error"] == np.inf
    (note,) = [note for note in result.notes if "no area is claimed" in note]
    assert "measure the points without a height again" in note


def test_another_method_takes_the_differences_of_boundary_elements():
    """The errors of a method come from the differences that another one computes."""
    surface = Surface(
        np.zeros(4), (1.0,), alternatives=(Alternative("form", ..., (np.ones(4),)),)
    )

    def step(area, gap):
        """Return a load step with an area fraction and a mean gap (m)."""
        return LoadStep(
            1.0, {"raw": Areas(area, area, 0.0)}, quantities={"mean_gap": gap}
        )

    base = [step(0.2, 3.0)]
    (found,) = with_measurement_errors(
        Scene(surface, MATERIAL, Load(1e-3)),
        [step(0.3, 5.0)],
        lambda changed: [step(0.2 + 0.01 * changed.surface.heights[0], 3.5)],
        base,
    )
    assert found.areas["form_error"].total == pytest.approx(0.02)
    assert found.quantities["mean_gap_error_by_form"] == pytest.approx(1.0)
    plain = replace(surface, alternatives=())
    steps = [step(0.3, 5.0)]
    unchanged = with_measurement_errors(scene_of(plain), steps, None)
    assert unchanged == tuple(steps)


# --- coverage, on a few of the laboratory's maps


def test_errors_of_levelled_periods_hold():
    """At least 90 % of the values of tilted periods are within their errors, and fewer
    mean gaps and conductances are without the part by form.
    """
    kinds = (measured_maps.hurst8, measured_maps.spheres25, measured_maps.lay)
    rows = measured_maps.of_form(kinds, [504, 505], n=48)
    within = rows["error"] <= rows["estimate"]
    assert within.mean() >= 0.9
    compliant = rows["value"].isin(["mean_gap", "conductance"])
    assert (rows["error"] <= rows["before"])[compliant].mean() < 0.75


def test_errors_of_maps_without_curvature_hold():
    """The same holds if a quadratic form was removed; without the part by form, fewer
    than three of four mean gaps and conductances are within their errors.
    """
    kinds = (measured_maps.hurst3, measured_maps.grains, measured_maps.ridged)
    rows = measured_maps.of_form(kinds, [504], n=48, order=2)
    assert (rows["error"] <= rows["estimate"]).mean() >= 0.9
    compliant = rows["value"].isin(["mean_gap", "conductance"])
    assert (rows["error"] <= rows["before"])[compliant].mean() < 0.75


def test_errors_of_maps_with_holes_hold():
    """At least 90 % of the claimed values of maps with holes are within their errors,
    and fewer are without the part by missing heights.
    """
    kinds = (measured_maps.grains, measured_maps.hurst8)
    rows = measured_maps.of_holes(kinds, [502], ("tops", "blobs"), (0.02, 0.1), n=64)
    claimed = rows[np.isfinite(rows["estimate"])]
    assert (claimed["error"] <= claimed["estimate"]).mean() >= 0.9
    assert (claimed["error"] <= claimed["before"]).mean() < 0.75
