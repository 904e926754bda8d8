"""The fractions of contact and load on heights that were filled or replaced."""

import json
from dataclasses import replace

import numpy as np
import pytest

from epcontact import alternatives, bem
from epcontact.errors import InvalidScene
from epcontact.harness.case_files.case import load_case
from epcontact.harness.quantities.registry import measure
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run
from epcontact.output.vtk import read_fields
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.surfaces import (
    Facing,
    HeightsFromArray,
    HeightsFromFile,
    filtered,
    residual_surface,
)

pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

X, Y = np.meshgrid(np.arange(24.0), np.arange(20.0), indexing="ij")
#: A high bump and a broad, lower one, in micrometres.
BUMPS = 3.0 * np.exp(-((X - 7) ** 2 + (Y - 6) ** 2) / 9)
BUMPS += 2.2 * np.exp(-((X - 17) ** 2 + (Y - 12) ** 2) / 20)
#: Two of three points of the high bump have no height, and one in the valley has none.
HOLES = ((BUMPS > 1.0) & (X < 12) & ((X + 2 * Y) % 3 != 0)) | ((X == 21) & (Y == 2))
MAP = np.where(HOLES, np.nan, BUMPS)
FRACTIONS = ("filled_contact", "filled_load")


def mirror(field):
    """Return an (nx, ny) field and its mirror images, as one period of (2 nx, 2 ny)."""
    return np.pad(field, [(0, length) for length in field.shape], mode="symmetric")


MIRRORED = mirror(HOLES)


CASE = """
[case]
id = "filled"
requirement = "Contact stands on measured heights."
source = "made for the tests"
methods = ["bem"]

[surface]
kind = "file"
path = "map.csv"
unit = 1e-6
pixel_size = 2e-6
form = 0
missing = "{missing}"
outliers = "remove"

[material]
young_modulus = 100.0e9
poisson_ratio = 0.3
hardness = 6.0e9

[load]
mean_pressure = [1e6, 4e7, 3e8]
"""


@pytest.fixture
def solve(tmp_path):
    """Return a function that solves a case of a map by boundary elements."""

    def solve(heights, missing="nearest", rows=True):
        """Solve a map of heights (24 x 20, micrometres) and return (scene, result, JSON
        of the method).

        `missing` is the key of the case file that says how holes are filled; `rows` is
        that of `Run`.
        """
        np.savetxt(tmp_path / "map.csv", heights.T, delimiter=",")
        path = tmp_path / "filled.toml"
        path.write_text(CASE.format(missing=missing))
        case = load_case(path)
        run = Run(tmp_path / "out", jobs=1, rows=rows, fields="first", fresh=True)
        (result,) = run_cases([case], run)["filled"]["bem"].results
        data = json.loads((case.folder(run.folder) / "bem.json").read_text())
        return case.scene(case.recipes[0]), result, data

    return solve


def fractions_by_hand(scene, load, mask):
    """Return the fractions of contact points and of load inside a mask at a load."""
    pressure = bem.solve(replace(scene, load=Load(load))).fields["pressure"]
    touching = pressure > 0
    contact = np.count_nonzero(touching & mask) / np.count_nonzero(touching)
    return contact, pressure[mask].sum() / pressure.sum()


@pytest.mark.parametrize("rows", [True, False])
def test_each_load_has_its_fractions_on_filled_heights(solve, tmp_path, rows):
    """The high bump, on which heights are filled, carries less of the heavy load."""
    scene, result, data = solve(MAP, rows=rows)
    loads = []
    for step, row in zip(result.steps, data["loads"], strict=True):
        expected = fractions_by_hand(scene, step.mean_pressure, MIRRORED)
        found = [step.quantities[name] for name in FRACTIONS]
        assert found == pytest.approx(expected, rel=1e-6)
        assert [row[name]["mean"] for name in FRACTIONS] == found
        assert [step.row[name] for name in FRACTIONS] == found
        loads.append(found[1])
    assert 0.5 < loads[0] < loads[1] > 2 * loads[2] > 2 * MIRRORED.mean()
    table = result.table()
    assert {"filled_contact", "filled_load"} <= set(table.columns)
    (note,) = [note for note in result.notes if "of the load" in note]
    worst = f"{100 * loads[1]:.3g} % of the load at 4e+07 Pa is on heights that were"
    assert note.startswith(worst)
    assert "measure the points without a height again" in note
    file = read_fields(tmp_path / "out/filled/fast/bem.vti")
    assert np.array_equal(file.fields["filled"], MIRRORED)
    assert file.fields["filled"].dtype == np.uint8


def test_a_map_without_holes_has_no_such_columns(solve, tmp_path):
    """Without filled heights neither quantities, rows, notes nor fields
    mention them.
    """
    _, result, data = solve(BUMPS)
    for step, row in zip(result.steps, data["loads"], strict=True):
        assert not {*FRACTIONS} & {*step.quantities, *row}
    assert not any("filled" in note for note in result.notes)
    assert "filled" not in read_fields(tmp_path / "out/filled/fast/bem.vti").fields


def test_a_run_solves_the_alternatives_of_a_large_map_on_fewer_points(
    solve, monkeypatch
):
    """A run has the same errors by missing heights as boundary elements alone, all of
    them from fewer points, and such an error for a column that only a run measures.
    """
    monkeypatch.setattr(alternatives, "LARGEST_GRID", MIRRORED.size // 4)
    scene, result, _ = solve(MAP)
    alone = bem.solve(scene)
    monkeypatch.undo()
    on_all_points = bem.solve(scene)
    for steps in zip(result.steps, alone.steps, on_all_points.steps, strict=True):
        rows = [step.row for step in steps]
        assert rows[0]["mean_gap"] == rows[2]["mean_gap"]
        errors = [row["mean_gap_error_by_missing"] for row in rows]
        assert errors[0] == pytest.approx(errors[1], rel=1e-9)
        assert errors[0] != errors[2]
        assert rows[0]["contact_percolation_error_by_missing"] >= 0


def test_no_area_is_claimed_where_filled_points_carry_most_of_the_load(solve):
    """Areas have an infinite error, and a note says so, where more than half of the
    load is on filled points, or is on them in a filling that agrees with the map, too.
    """
    _, result, data = solve(MAP, "harmonic")
    assert 0.2 < max(step.quantities["filled_load"] for step in result.steps) < 0.5
    errors = [step.row["total_area_error"] for step in result.steps]
    assert errors[0] == np.inf > max(errors[1:])
    assert data["loads"][0]["total_area"]["parts"]["missing"] == "inf"
    (note,) = [note for note in result.notes if "of the load" in note]
    assert note.startswith("more than half of the load at 1e+06 Pa may be on heights")
    assert "no area is claimed" in note


def test_a_few_holes_in_a_valley_add_an_error_and_no_note(solve):
    """A hole where nothing touches has no load, no note, and a small error."""
    given = np.where((X == 21) & (Y == 2), np.nan, BUMPS)
    _, result, _ = solve(given)
    for step in result.steps:
        assert step.quantities["filled_load"] == 0
        assert step.areas["missing_error"].total < 1e-3 * step.best_areas.total
    assert not any("of the load" in note for note in result.notes)


def test_removed_outliers_count_as_replaced(solve):
    """A removed spike is marked as filled, with its fractions of contact and load."""
    spiked = BUMPS.copy()
    spiked[7, 6] += 30
    spikes = np.zeros_like(HOLES)
    spikes[7, 6] = True
    mirrored = mirror(spikes)
    scene, result, _ = solve(spiked)
    assert np.array_equal(scene.surface.filled, mirrored)
    expected = fractions_by_hand(scene, 4e7, mirrored)
    found = [result.steps[1].quantities[name] for name in FRACTIONS]
    assert found == pytest.approx(expected, rel=1e-6)
    assert 0 < found[1] < found[0] < 0.5
    kept = HeightsFromArray(spiked, (240.0, 200.0), "mirrored").build()
    assert kept.filled is None


def test_a_seventh_of_three_equal_plateaus():
    """Three of 21 points of contact are filled: 1/7 of the contact, and their part of
    the load.

    The plateaus have 7 of 60 points each. Without a mask the fraction is 0.
    """
    heights = np.full(60, -1.0)
    for start in (3, 23, 43):
        heights[start : start + 7] = 0.0
    holes = np.zeros(60, bool)
    holes[25:28] = True
    recipe = HeightsFromArray(
        np.where(holes, np.nan, heights), (60.0,), "periodic", missing="nearest"
    )
    surface = recipe.build()
    assert np.array_equal(surface.filled, holes)
    scene = Scene(surface, Material(1e4, 0.3, hardness=1.0), Load(0.33))
    result = bem.solve(scene)
    assert measure("quantity.filled_contact", scene, result) == pytest.approx(1 / 7)
    pressure = result.fields["pressure"]
    by_hand = pressure[holes].sum() / (60 * 0.33)
    assert measure("quantity.filled_load", scene, result) == pytest.approx(by_hand)
    whole = replace(scene, surface=Surface(surface.heights, surface.periods))
    assert measure("quantity.filled_load", whole, result) == 0


def test_the_mask_goes_where_the_heights_go(solve, tmp_path):
    """The mask follows the heights to filtered, residual and facing surfaces and to
    files.
    """
    scene, _, _ = solve(MAP)
    surface = scene.surface
    assert np.array_equal(surface.filled, MIRRORED)
    assert not surface.filled.flags.writeable
    left = residual_surface(surface, bem.solve(scene))
    waves = filtered(surface, 1e6)
    for follower in (left, waves):
        assert np.array_equal(follower.filled, MIRRORED)
    again = HeightsFromFile(tmp_path / "out/filled/fast/bem.vti").build()
    assert np.array_equal(again.filled, MIRRORED)

    other = np.where((X == 3) & (Y == 15), np.nan, BUMPS)
    first, second, solid = (
        HeightsFromArray(heights, (240.0, 200.0), "periodic", missing="harmonic")
        for heights in (MAP, other, BUMPS)
    )
    faced = Facing(first, second).build()
    assert np.array_equal(faced.filled, HOLES | np.isnan(other))
    assert np.array_equal(Facing(solid, second).build().filled, np.isnan(other))
    assert Facing(solid, solid).build().filled is None


def test_a_digest_knows_the_mask_of_heights_without_a_recipe():
    """The fingerprint of a surface depends on its mask; an empty mask
    counts as none.
    """
    heights = BUMPS * 1e-6
    plain = Surface(heights, (1.0, 1.0))
    marked = Surface(heights, (1.0, 1.0), filled=HOLES)
    unmarked = Surface(heights, (1.0, 1.0), filled=np.zeros_like(HOLES))
    assert plain.fingerprint == unmarked.fingerprint != marked.fingerprint
    assert unmarked.filled is None


@pytest.mark.parametrize("mask", [HOLES.T, HOLES * 1.0, HOLES[0], "holes"])
def test_a_mask_that_is_none_is_refused(mask):
    """A mask of another shape or type raises `InvalidScene`."""
    with pytest.raises(InvalidScene, match=r"filled is an array of .*must be a mask"):
        Surface(BUMPS, (1.0, 1.0), filled=mask)
