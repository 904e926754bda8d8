"""Heights from arrays and files: formats, units, periodicity, and every way to be
wrong.
"""

import contextlib
import itertools
import math
import pickle
import sys
import types
import warnings
import zipfile
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import meshio
import numpy as np
import pytest
from laboratory.trial_map import trial_map

from epcontact import bem, persson
from epcontact.errors import InvalidScene, SurfaceWarning
from epcontact.planning.grids import one_directional
from epcontact.results import COLUMNS
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.studies.areas import KINDS, member
from epcontact.surfaces import (
    HeightsFromArray,
    HeightsFromFile,
    SelfAffine,
    readers,
    recipes_of,
)
from epcontact.surfaces.power_spectrum import even_moments, surface_moments
from epcontact.surfaces.treatment import (
    EDGE_ERRORS,
    EDGE_FRACTIONS,
    edge_jumps,
    fill_holes,
    find_outliers,
    remove_form,
)

# The heights are about as large as the period, which changes nothing of what is tested
# here.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

L = 2 * math.pi
X = np.arange(64.0) - 32
HILLS = np.sin(X[:, None] / 2) + np.cos(X / 3 + 0.4 * X[:, None])
SPECTRUM = SelfAffineSpectrum(0.8, 1.0, 4.0, 20.0, 0.5)
MAP = SelfAffine(SPECTRUM, (L, L), (48, 50), seed=1).build().heights
#: A piece of a larger surface, tilted: as a profilometer sees it.
CUT_OUT = MAP[:40, :31] + 0.01 * np.arange(40)[:, None] - 0.02 * np.arange(31)
GOOD = HeightsFromArray(HILLS, (1e3, 1e3), "periodic")
STEPS, MARKED, OBLONG = (
    "are in steps of",
    "heights are -9999, far from all others",
    "times as long",
)
HUGE = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 1000000000)}\n"


@pytest.fixture
def write(tmp_path):
    """Write bytes, or heights [x, y] as a picture in the format of the name's
    ending.
    """

    def write(name, content):
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
            return path
        content = np.transpose(content)
        if path.suffix == ".npy":
            np.save(path, content)
        else:
            delimiter = {".csv": ",", ".dat": ";"}.get(path.suffix, " ")
            np.savetxt(
                path, content, delimiter=delimiter, header="heights, in micrometres"
            )
        return path

    return write


def refused(words):
    return pytest.raises(InvalidScene, match=words)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.npy", ">f8"),
        ("a.npy", "<i2"),
        ("a.txt", "f8"),
        ("a.dat", "f8"),
        ("A.CSV", "f8"),
    ],
)
def test_every_format_holds_the_same_heights(write, name, kind):
    heights = np.asfortranarray((1e3 * MAP).astype(kind))
    surface = HeightsFromFile(write(name, heights), (L, 2 * L), 1e-6, "refuse").build()
    # savetxt writes 19 digits; the unit costs a rounding.
    assert np.array_equal(surface.heights, heights * 1e-6)
    assert (surface.periods, "as in its picture" in str(surface.notes)) == (
        (L, 2 * L),
        True,
    )
    line = MAP[3]
    for written in (line, line[:, None]):  # one column, one row
        path = write(name, written.squeeze() if name.endswith("npy") else written)
        assert np.array_equal(
            HeightsFromFile(path, (3.0,), 1.0, "refuse").build().heights, line
        )


@pytest.mark.parametrize(
    ("name", "content", "notes"),
    [
        ("a.csv", b"1.5,2.5,\n3.5,4.5,\n", []),  # each line ends with a separator
        ("a.txt", b"1.5, 2.5\n3.5, 4.5\n", []),
        ("b.csv", b"1,5;2,5\n3,5;4,5\n", ["decimal commas"]),
        ("c.txt", b"1,5 2,5\n3,5 4,5\n", ["decimal commas"]),
        (
            "d.txt",
            "Höhe in µm\nx y\n1.5\t2.5\n3.5\t4.5\n".encode("latin-1"),
            ["s: 2", "Latin-1"],
        ),
        (
            "e.csv",
            "\ufeffh;h\r\n1.5;2.5\r\n\r\n3.5;4.5 # last\r\n".encode(),
            ["of heights: 1"],
        ),
        # As spreadsheets save "Unicode text".
        (
            "f.txt",
            "\ufeffh\n1.5\t2.5\n3.5\t4.5\n".encode("utf-16-le"),
            ["s: 1", "as UTF-16"],
        ),
    ],
)
def test_tables_as_programs_write_them(write, name, content, notes):
    surface = HeightsFromFile(
        write(name, content), (100.0, 100.0), 1.0, "periodic"
    ).build()
    assert np.array_equal(surface.heights, [[1.5, 3.5], [2.5, 4.5]])
    assert all(any(words in note for note in surface.notes) for words in notes)


def test_commas_that_are_both_separators_and_decimals_are_told(write):
    lines = "\n".join(
        ",".join(f"{v:.3f}".replace(".", ",") for v in row) for row in MAP[:9, :8]
    )
    with refused("its commas separate the numbers and are decimal commas"):
        HeightsFromFile(write("map.csv", lines.encode()), (L, L), 1.0).build()
    whole = write("whole.csv", b"10,20,3,40\n5,60,7,80\n9,10,11,12\n")
    assert HeightsFromFile(whole, (400.0, 300.0), 1.0).build().heights.shape == (8, 6)


def test_coordinates_beside_the_heights_are_told(write):
    table = np.column_stack([np.arange(12) * 0.8, MAP[:12, :10]])
    path = write("map.csv", np.vstack([[np.nan, *range(10)], table]))
    recipe = HeightsFromFile(path, (L, L), 1.0, "periodic", missing="nearest")
    told = [note.split()[2] for note in recipe.build().notes if "even steps" in note]
    assert told == ["column", "line"]
    plane = write("plane.csv", np.add.outer(np.arange(12.0), 2.0 * np.arange(10)))
    assert "even steps" not in str(HeightsFromFile(plane, (L, L), 1.0).build().notes)
    huge = np.array([-9.24e307, 9.24e307])[np.arange(12 * 9).reshape(12, 9) % 2]
    with refused("heights"):  # whose steps a number cannot hold
        HeightsFromFile(write("huge.csv", huge), (L, L), 1.0, "periodic").build()


@pytest.mark.parametrize("name", ["binary.stl", "map.ply", "map.vtu"])
def test_meshes_on_a_grid_are_height_maps(tmp_path, name):
    heights = MAP[:12, :9].astype(np.float32).astype(float)  # the digits of binary .stl
    x, y = np.meshgrid(3 + np.arange(12) * 0.1, np.arange(9) * 0.25 - 7, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), heights.ravel()], axis=1)

    def read(points):
        triangles = np.arange(len(points), dtype=np.int32).reshape(3, -1).T
        binary = {"binary": True} if name.startswith("binary") else {}
        meshio.Mesh(points, [("triangle", triangles)]).write(tmp_path / name, **binary)
        return HeightsFromFile(tmp_path / name, unit=1e-3, treatment="periodic", form=0)

    recipe = read(points)
    assert recipe.periods == pytest.approx((1.2e-3, 2.25e-3), rel=1e-6)
    assert recipe.build().heights == pytest.approx(
        1e-3 * (heights - heights.mean()), abs=1e-15
    )
    above = np.concatenate([points, points + np.array([0, 0, 5])])
    scattered = points + np.random.default_rng(1).uniform(0, 0.1, points.shape)
    for wrong in (above, scattered, points[:, [2, 0, 1]]):
        with refused(f"{name}: its points are no height map"):
            read(wrong)


def test_lists_of_points_are_maps_with_or_without_missing_points(write):
    """As an instrument writes them: points without a height are left out, or marked."""
    x, y = np.meshgrid(2.0 + 0.4 * np.arange(12), 0.8 * np.arange(9), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), MAP[:12, :9].ravel()])
    rng = np.random.default_rng(3)
    for name, gone in (
        ("whole.xyz", 0),
        ("map.csv", 0),
        ("gaps.xyz", 30),
        ("gaps.txt", 30),
    ):
        left = rng.permutation(points)[gone:]
        text = "X, Y, Z\n" + "\n".join(
            ",".join(map(repr, row)) for row in left.tolist()
        )
        path = write(name, text.encode() + b"\n2.4, 0.8, No Data" * (name == "marked"))
        steps: Any = {"treatment": "periodic", "missing": "nearest", "form": 0}
        recipe = HeightsFromFile(path, unit=1e-6, **steps)
        assert recipe.shape == (12, 9)
        assert recipe.periods == pytest.approx((4.8e-6, 7.2e-6), rel=1e-12)
        surface, told = recipe.build(), f"{gone} of 108 heights missing"
        there = np.isin(MAP[:12, :9], left[:, 2])
        level = MAP[:12, :9][there] - left[:, 2].mean()
        assert surface.heights[there] == pytest.approx(1e-6 * level, abs=1e-18)
        assert any(told in note for note in surface.notes) == (gone > 0)
        assert "its columns are x, y and height, all in one unit" in surface.notes
    sparse = "\n".join(" ".join(map(repr, row)) for row in points[::2].tolist()[:-5])
    with refused("sample them on a grid first"):  # more are missing than there
        HeightsFromFile(write("sparse.xyz", sparse.encode()), unit=1e-6)
    marked = write("marked.xyz", b"0 0 No Data\n0 1 2\n1 0 3\n1 1 4\n")
    assert HeightsFromFile(marked, unit=1.0, missing="nearest").shape == (2, 2)


def test_a_zip_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(readers, "_UNPACKED", 2**20)
    monkeypatch.setitem(
        sys.modules, "SurfaceTopography", types.SimpleNamespace(open_topography=0)
    )
    path = tmp_path / "bomb.x3p"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("data.bin", bytes(2**21))
    with refused("bomb.x3p: unpacks from 0.00.* MiB to 2 MiB"):
        HeightsFromFile(path, (1.0, 1.0))


@pytest.mark.parametrize("spikes", [1, 25])
def test_outliers_are_told_with_their_places_and_removed_on_demand(spikes):
    clean, given = 1e-6 * trial_map(0), 1e-6 * trial_map(spikes)
    moved = np.nan_to_num(np.abs(given - clean)) > 1e-7
    steps: Any = {"missing": "harmonic", "form": 1}
    with pytest.warns(SurfaceWarning, match=f"{spikes} of 120000 heights are outliers"):
        HeightsFromArray(given, (320e-6, 240e-6), "periodic", **steps).build()
    kept, removed = (
        HeightsFromArray(
            given, (320e-6, 240e-6), "periodic", outliers=word, **steps
        ).build()
        for word in ("keep", "remove")
    )
    truth = HeightsFromArray(clean, (320e-6, 240e-6), "periodic", **steps).build()
    # In the place of a spike is the mean of its neighbours, whose waves have four
    # points or more.
    assert np.abs(removed.heights - truth.heights)[moved].max() < 0.3e-6
    assert np.abs(removed.heights - truth.heights)[~moved].max() < 0.01e-6
    assert kept.rms_slope > 1.02 * truth.rms_slope
    assert removed.rms_slope == pytest.approx(truth.rms_slope, rel=1e-3)
    # What was removed is not counted as missing.
    missing = int(np.isnan(given).sum())
    assert any(f"{missing} of 120000 heights missing" in n for n in removed.notes)


@pytest.mark.parametrize("kind", sorted(KINDS.keys() - {"outliers"}))
def test_what_a_real_surface_does_is_no_outlier(kind):
    for seed in (21, 22):
        heights = KINDS[kind](
            member(KINDS, kind, seed, 96), np.random.default_rng(seed)
        )
        assert not find_outliers(heights).any()
        assert not find_outliers(np.round(heights / np.ptp(heights) * 60)).any()


def test_a_plane_or_constant_is_flat_to_the_last_digit():
    x, y = np.meshgrid(np.arange(40.0), np.arange(31.0), indexing="ij")
    for order, heights in (
        (1, 0.1 + 0.3 * x - 0.7 * y),
        (1, 0 * x + 0.1),
        (2, 5 + x * x - x * y),
    ):
        for form in (1, 2):
            surface = HeightsFromArray(
                1e-6 * heights, (1e-3, 1e-3), "periodic", form=form
            ).build()
            assert (np.ptp(surface.heights) == 0) == (form >= order)
            assert ("the rest is rounding error" in str(surface.notes)) == (
                form >= order
            )
    rough = HeightsFromArray(1e-9 * HILLS + 1.0, (1.0, 1.0), "periodic", form=1).build()
    assert rough.rms_height > 1e-10


def test_a_tilt_is_removed_before_a_map_is_taken_as_periodic_and_a_period_is_left_as_it_is():
    tilted = MAP + 0.3 * np.arange(48)[:, None]
    level, kept = (
        HeightsFromArray(tilted, (L, L), "periodic", form=f).build() for f in (1, 0)
    )
    found, same = (
        HeightsFromArray(h, (L, L), "periodic").build() for h in (tilted, MAP)
    )
    assert np.array_equal(found.heights, level.heights)
    assert "least-squares plane removed, because its tilt" in str(found.notes)
    assert found.treatment_errors
    assert kept.rms_height > 3 * level.rms_height
    assert np.array_equal(same.heights, MAP)


def test_periods_by_one_length_or_by_the_pixel(write):
    square, oblong = write("square.npy", MAP[:, :48]), write("oblong.npy", MAP)
    assert HeightsFromFile(square, (2.0,), unit=1.0).periods == (2.0, 2.0)
    assert HeightsFromFile(oblong, pixel_size=0.5, unit=1.0).periods == (24.0, 25.0)
    changes: list[tuple[dict[str, Any], str]] = [
        ({"periods": (2.0,)}, "48 x 50 .* give both"),
        ({}, "does not say how large"),
        ({"periods": (1.0, 1.0), "pixel_size": 1.0}, "not both"),
        (
            {"periods": (1.0, 1.0), "unit": None},
            "in which unit its heights are; give unit = 1e-6",
        ),
        ({"periods": (1.0, 1.0, 1.0)}, "2 positive lengths"),
        ({"path": oblong.parent}, "is a folder"),
        ({"path": oblong.with_name("none.npy")}, "none.npy: no such file"),
    ]
    for arguments, message in changes:
        with refused(message):
            HeightsFromFile(**{"path": oblong, "unit": 1.0} | arguments)
    with refused(
        "oblong.npy: the rms slope is .*, beyond that of any surface; .* check unit"
    ):
        HeightsFromFile(oblong, pixel_size=1e-3, unit=1.0).build()
    marked = np.where(np.arange(MAP.size).reshape(MAP.shape) % 400 < 2, -9999.0, MAP)
    with refused("check unit, .*; or 12 heights are -9999, far from all others"):
        HeightsFromFile(write("marks.txt", marked), pixel_size=1.0, unit=2.0).build()
    steep = HeightsFromFile(oblong, pixel_size=1.0, unit=1.0, form=0).build().rms_slope
    for slope in (0.9e-4, 1.1e-4, 9.0, 11.0):
        recipe = HeightsFromFile(oblong, pixel_size=1.0, unit=slope / steep, form=0)
        with (
            refused(r"the rms slope is 11, beyond")
            if slope > 10
            else contextlib.nullcontext()
        ):
            flat = "the rms slope is 9e-05, below that of any but optical flats; the "
            assert (flat in str(recipe.build().notes)) == (slope < 1e-4)


def test_the_content_and_its_treatment_are_the_identity_not_the_place(write):
    path, other = write("one.npy", MAP), write("other.npy", MAP)
    changes: list[dict[str, Any]] = [
        *({"path": write("changed.npy", MAP + 1e-12)}, {"unit": 1e-6}),
        *({"treatment": "periodic"}, {"treatment": "mirrored"}),
        *({"form": 1}, {"form": 2}, {"missing": "nearest"}, {"missing": "harmonic"}),
        {"outliers": "remove"},
        *({"longest_wavelength": 1.0}, {"shortest_wavelength": 0.1}),
    ]
    recipe = HeightsFromFile(path, (L, L), 1.0, "refuse")
    assert replace(recipe, path=other).fingerprint == recipe.fingerprint
    assert (
        len({r.fingerprint for r in [recipe, *(replace(recipe, **c) for c in changes)]})
        == 12
    )
    # It travels to another process without its heights.
    sent = pickle.dumps(recipe)
    arrived = pickle.loads(sent)
    assert len(sent) < 1000 < MAP.nbytes
    assert (arrived, arrived.fingerprint) == (recipe, recipe.fingerprint)
    # An array is copied, and gives the surface that the file gives.
    given = MAP.copy()
    array = HeightsFromArray(given, (L, L))
    given[...] = 0
    assert np.array_equal(arrived.build().heights, array.build().heights)
    assert array.build().recipe == array.fingerprint


def test_a_map_is_periodic_wherever_it_is_cut_or_refused_with_its_jump():
    for shift in range(0, 48, 5):
        moved = np.roll(MAP, (shift, shift), (0, 1))
        surface = HeightsFromArray(moved, (L, L)).build()
        assert np.array_equal(surface.heights, moved)
        assert "rms jump at the edges" in surface.notes[0]
    near, far = (
        np.array([0.0, 0.7, 1.4, 0.7 * jump]) for jump in (1.9, 2.1)
    )  # over the rest
    HeightsFromArray(near, (1e3,)).build()
    wall = np.repeat([1.0, 0.0], 4)[:, None] * np.ones(8)
    HeightsFromArray(wall, (1.0, 1.0)).build()  # as steep inside as across the edge
    ramp = np.zeros((20, 10)) + 0.5 * np.arange(20)[:, None]
    jump = r"jump at the edges: 9.5 m across x \(between neighbours at most 0.5 m"
    for heights, message in ((ramp, jump), (CUT_OUT, "across y"), (far, "not p")):
        with refused(message):
            HeightsFromArray(heights, (1.0,) * heights.ndim).build()


@pytest.mark.parametrize("shape", [(40, 31), (60,)])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_form_is_all_gone(shape, order):
    grids = np.meshgrid(*(np.arange(n) / 10 for n in shape), indexing="ij")
    powers = [
        np.full(shape, 3.0),
        sum(grids),
        sum((g - 1) ** 2 for g in grids) + math.prod(grids),
    ]
    form = sum(powers[: order + 1])
    rough = np.random.default_rng(0).standard_normal(shape)
    rough[3:9] = np.nan
    bare = remove_form(rough, order)
    # The form is 40 high at most, so it leaves a few of its roundings.
    assert np.nanmax(np.abs(remove_form(rough + form, order) - bare)) < 1e-12
    # What is left is orthogonal to the form, as least squares leave it.
    assert np.nansum(bare * form) == pytest.approx(0, abs=1e-10)


def test_missing_points_are_filled_and_said(write):
    x, y = np.meshgrid(np.arange(20.0), np.arange(16.0), indexing="ij")
    saddle = x * y + 3 * x  # harmonic on the grid, too
    holed = saddle.copy()
    holed[4:12, 3:9] = np.nan
    steps: Any = {"missing": "harmonic", "treatment": "periodic", "form": 0}
    for recipe in (
        HeightsFromArray(np.ma.masked_invalid(holed), (L, L), **steps),
        HeightsFromFile(write("map.npy", holed), (1e3, 1e3), unit=1.0, **steps),
    ):
        surface = recipe.build()
        assert surface.heights + np.nanmean(holed) == pytest.approx(saddle, abs=1e-10)
    assert fill_holes(holed, "nearest")[4, 5] == saddle[3, 5]
    edge = np.array(
        [np.nan, np.nan, 1.0, np.nan, 4.0, np.nan]
    )  # at a right angle to the edge
    assert fill_holes(edge, "harmonic") == pytest.approx([1, 1, 1, 2.5, 4, 4])


def test_waves_outside_a_band_are_removed():
    x = np.arange(64) * L / 64
    heights = np.cos(x) + np.cos(3 * x) + np.cos(9 * x)
    band = {"longest_wavelength": L / 2, "shortest_wavelength": L / 5}
    surface = HeightsFromArray(heights, (L,), **band).build()
    assert surface.heights == pytest.approx(np.cos(3 * x), abs=1e-14)


def test_a_file_is_mirrored_so_that_no_edge_is_left(write):
    """A map that is even about its edges is periodic, and has the map's slopes and its
    areas.
    """
    recipe = HeightsFromFile(write("cut.npy", CUT_OUT), pixel_size=0.5, unit=1.0)
    (of_all,) = recipes_of(recipe)
    surface, inside = of_all.build(), remove_form(CUT_OUT, 1)
    assert surface.shape == of_all.shape == (80, 62)
    assert surface.periods == of_all.periods == (40.0, 31.0)
    assert surface.heights[:40, :31] == pytest.approx(inside, abs=1e-12)
    for turned in (surface.heights[::-1], surface.heights[:, ::-1]):
        assert np.array_equal(turned, surface.heights)
    assert all(edge == 0 for edge, _ in edge_jumps(surface.heights))
    moments = surface_moments(surface)
    assert even_moments(inside, (0.5, 0.5)) == pytest.approx(moments, rel=1e-12)


def test_edges_have_an_error_of_their_own_that_is_told_and_falls_with_the_size():
    """It is in the claimed error of areas of both theory and numerics, as a part of its
    own.
    """
    spectrum = SelfAffineSpectrum(0.8, L / 64, L / 16, L / 4, 0.05)
    large = SelfAffine(spectrum, (256.0, 256.0), (256, 256), seed=3).build().heights
    shares = {}
    for n, treatment in itertools.product((48, 96), ("mirrored", "periodic")):
        cut = large[:n, : 3 * n // 4]  # no square
        surface = HeightsFromArray(cut, cut.shape, treatment, form=1).build()
        found = even_moments(remove_form(cut, 1), (1.0, 1.0))
        length = found.rms_slope / found.rms_curvature / (3 * n // 4)
        share = {name: times * length for name, times in EDGE_ERRORS[treatment].items()}
        assert surface.treatment_errors == pytest.approx(
            share | EDGE_FRACTIONS[treatment], rel=1e-9
        )
        shares[treatment, n] = share["elastic_area"]
    assert (
        shares["mirrored", 96]
        < 0.6 * shares["mirrored", 48]
        < 0.6 * shares["periodic", 48]
    )
    scene, known = (
        Scene(surface, Material(1.0, 0.0, hardness=0.01), Load(5e-4)),
        COLUMNS.keys(),
    )
    for answer in (
        bem.solve(scene),
        persson.solve(scene, energy_reduction=1, spectrum="surface"),
    ):
        row = answer.final.row
        assert answer.notes[: len(surface.notes)] == surface.notes
        for name in known & surface.treatment_errors.keys() & row.keys():
            of = row["total_area"] if name.endswith("area") else row[name]
            expected = surface.treatment_errors[name] * of
            assert row[f"{name}_error_by_treatment"] == pytest.approx(
                expected, rel=1e-12
            ), name
        assert row["mean_gap_error"] >= row["mean_gap_error_by_treatment"] > 0
        assert (
            row["elastic_area_error_by_treatment"]
            > row["plastic_area_error_by_treatment"]
            > 0
        )
    whole = HeightsFromArray(large, (256, 256)).build()
    assert not whole.treatment_errors
    assert "treatment_error" not in bem.solve(replace(scene, surface=whole)).final.areas


def test_the_slope_of_an_effective_hardness_does_not_see_the_jumps_at_the_edges():
    spectrum = SelfAffineSpectrum(0.8, L / 256, L / 64, L / 4, 0.05)
    large = SelfAffine(spectrum, (256.0, 256.0), (256, 256), seed=4).build()
    cut = remove_form(large.heights[:64, :64], 1)
    seen = surface_moments(Surface(cut, (64.0, 64.0))).rms_slope
    assert even_moments(cut, (1.0, 1.0)).rms_slope == pytest.approx(0.05, rel=0.05)
    assert seen > 1.1 * 0.05


def test_slopes_beyond_one_are_said_once():
    """They are a note, and a warning of the line that makes the surface, not of later
    ones.
    """
    recipe = HeightsFromArray(MAP * 1e3, (L, L))
    with pytest.warns(SurfaceWarning, match="beyond the small slopes") as warned:
        steep = recipe.build()
    assert [(str(one.message), one.filename) for one in warned] == [
        (steep.notes[-2], __file__)
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (
            replace(steep).notes
            == pickle.loads(pickle.dumps(steep)).notes
            == steep.notes
        )
        assert (
            one_directional(recipe) is None
        )  # the package builds it and shows the notes itself
        assert len(HeightsFromArray(MAP / 10, (L, L)).build().notes) == 2


@pytest.mark.parametrize(
    ("heights", "periods", "doubts"),
    [
        (
            np.round(MAP / (0.3 * MAP.std())),
            (1e3, 1e3),
            {STEPS, "neither for these steps nor"},
        ),
        (
            np.round(MAP / (0.01 * MAP.std())),
            (1e3, 1e3),
            {STEPS, "but not for its steps"},
        ),
        (np.round(MAP / (0.002 * MAP.std())), (1e3, 1e3), set()),
        (np.round(8 * HILLS).astype(np.float32) * np.float32(0.1), (1e3, 1e3), {STEPS}),
        (np.round(8 * HILLS[3]), (1e3,), {STEPS}),
        # Treads that are wide, and slopes that rise by one step from each point to the
        # next.
        (
            np.round(np.sin(X / 10)[:, None] + np.sin(X / 10)),
            (1e3, 1e3),
            {STEPS, "for these"},
        ),
        (-np.maximum(np.abs(X)[:, None], np.abs(X)), (1e3, 1e3), set()),
        (np.where(HILLS > 1.9, -9999.0, HILLS), (1e3, 1e3), {MARKED}),
        (np.where(HILLS > 1.9, -9999.0, 0.0), (1e3, 1e3), set()),  # a post is no mark
        (HILLS > 0, (1e3, 2e3), {"in a picture"}),
        (HILLS, (2.1e3, 1e3), {f"the grid's cells are 2.1 {OBLONG} as wide"}),
        (HILLS, (1e3, 1e5), {f"the grid's cells are 100 {OBLONG} as wide"}),
    ],
)
def test_what_a_user_should_doubt_is_noted(heights, periods, doubts):
    notes = " ".join(HeightsFromArray(heights, periods, "periodic").build().notes)
    assert all(words in notes for words in doubts)
    assert not any(
        words in notes for words in {STEPS, MARKED, OBLONG} if words not in str(doubts)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"heights": np.array([["1", "2"], ["3", "4"]])}, "holds <U1 values"),
        ({"heights": np.float64(3)}, r"shape \(\)"),
        ({"heights": np.ones((4, 4, 4))}, r"shape \(4, 4, 4\)"),
        ({"heights": [[1.0, 2.0], [3.0]]}, "unequal length"),
        ({"heights": np.array([[1, 2], [3, np.inf]])}, "1 of 4 heights are infinite"),
        (
            {"heights": np.ma.masked_greater(HILLS, 1)},
            'NaN or masked; .*set missing to "harmonic"',
        ),
        ({"heights": HILLS * 1e41}, "heights reach .*; check their unit"),
        (
            {"heights": HILLS * 1e-300},
            "heights span .* less than 1e-40 m; check their unit",
        ),
        (
            {"treatment": "window"},
            "treatment is 'window', but must be one of mirrored, periodic",
        ),
        ({"periods": (L,)}, "2 positive lengths"),
        ({"form": 3}, "form is 3"),
        (
            {"longest_wavelength": 0.1, "shortest_wavelength": 1},
            "must be below longest_wavelength",
        ),
    ],
)
def test_what_is_no_height_map_is_refused(change, message):
    with refused(message):
        replace(GOOD, **change)
    if "heights" in change:
        with refused(message):
            Surface(change["heights"], (1.0, 1.0))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.txt", b"", "is empty"),
        ("huge.npy", b"\x93NUMPY\x01\x00L\x00" + HUGE.encode(), "no complete .npy"),
        ("complex.npy", np.ones((4, 4)) * 1j, "holds complex values"),
        (
            "pickle.npy",
            np.array([{"a": 1}, {}], dtype=object).dumps(),
            "no complete .npy",
        ),
        ("junk.txt", bytes(range(256)) * 8, "no table of numbers"),
        ("late.txt", b"1 2\n" * 9000 + b"\xff 2\n", "line 9001 holds 'ÿ'"),
        ("words.txt", b"x y\nz t\n", "no line begins with a number"),
        ("ragged.csv", b"1,2\n3\n4,5\n", "line 2 holds 1 numbers, the one above 2"),
        ("points.csv", b"1.5;2,5\n3,5;4,5\n", "line 1 holds '1.5'"),
        ("middle.csv", b"1,2\nsome words,4\n3,4\n", "line 2 holds 'some words'"),
        ("nan.txt", b"nan nan\nnan nan\n", "4 of 4 heights are NaN or masked$"),
        ("inf.txt", b"1 1e999\n3 4\n", "1 of 4 heights"),
        (
            "date.txt",
            b"2026-01-02 12:00\n1 2\n3 4\n",
            "begin the lines of a header with #",
        ),
        (
            "off.xyz",
            b"0 0 5\n0 1 7\n1 .3 6\n1 1 5\n",
            "lie on no regular grid .* export the heig",
        ),
        ("junk.vti", b"<VTKFile", "no whole .vti file"),
        *(
            (f"junk.{kind}", b"junk\xff\n", "meshio cannot read")
            for kind in ("stl", "ply", "vtu")
        ),
    ],
    ids=lambda v: str(v)[:12],
)
def test_broken_files_end_in_a_sentence(write, name, content, words):
    with refused(words) as caught:
        HeightsFromFile(write(name, content), (1.0, 1.0), unit=1.0).build()
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@dataclass
class Topography:
    """The part of SurfaceTopography's topographies that is used here."""

    unit: str | None = "nm"
    hole: Any = False
    is_uniform: bool = True
    scale: float = 1e9

    @property
    def physical_sizes(self):
        return 2 * self.scale, 3 * self.scale

    def heights(self):
        return np.ma.masked_array(self.scale * MAP, self.hole)

    def to_unit(self, unit):
        return replace(self, unit=unit, scale=1.0)


def unreadable_topography():
    raise KeyError("tried XYZReader:\n no grid")


def test_instrument_files_know_their_size_and_unit(write, monkeypatch):
    path = write("map.sur", b"DIGITAL SURF")

    def read(topography, **options):
        def open_topography(_):
            return contextlib.nullcontext(types.SimpleNamespace(topography=topography))

        module: Any = types.SimpleNamespace(open_topography=open_topography)
        monkeypatch.setitem(sys.modules, "SurfaceTopography", module)
        return HeightsFromFile(path, **{"treatment": "refuse"} | options)

    assert read(Topography).periods == pytest.approx((2.0, 3.0))
    assert read(Topography).build().heights == pytest.approx(MAP, rel=1e-14)
    assert read(Topography, periods=(5.0, 6.0)).periods == (5.0, 6.0)
    with_unit = read(partial(Topography, None), periods=(2.0, 3.0), unit=1e-9).build()
    assert with_unit.heights == pytest.approx(MAP, rel=1e-14)
    for topography, options, sentence in (
        (Topography, {"unit": 1e-6}, "gives the unit"),
        (partial(Topography, None), {}, "in which unit"),
        (partial(Topography, None), {"unit": 1e-9}, "does not say how large"),
        (partial(Topography, hole=MAP > 0), {}, "of 2400 heights are NaN or masked"),
        (partial(Topography, is_uniform=False), {}, "no regular grid"),
        (
            unreadable_topography,
            {},
            r"tried XYZReader:.*no grid.*; export the",
        ),
    ):
        with refused(sentence):
            read(topography, **options).build()
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with refused(r"SurfaceTopography; pip install 'epcontact\[instr"):
        HeightsFromFile(path, (1.0, 1.0))
