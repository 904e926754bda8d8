"""Heights from arrays and files: formats, units, periodicity, and every way to be wrong."""

from __future__ import annotations

import contextlib
import math
import pickle
import shutil
import sys
import types
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from epcontact.errors import InvalidScene, SurfaceWarning
from epcontact.planning.grids import one_directional
from epcontact.scene import Body, Load, Material, SelfAffineSpectrum, Surface, rms_slope
from epcontact.surfaces import HeightsFromArray, HeightsFromFile, SelfAffine
from epcontact.surfaces.treatment import edge_jumps, filled, form_removed, windowed

# The heights are about as large as the period, which changes nothing of what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

L = 2 * math.pi
SPECTRUM = SelfAffineSpectrum(0.8, 1.0, 4.0, 20.0, 0.5)


def periodic(shape: tuple[int, ...] = (48, 50)) -> np.ndarray[Any, np.dtype[np.float64]]:
    return SelfAffine(SPECTRUM, (L,) * len(shape), shape, seed=1).build().heights


def cut_out(shape: tuple[int, int] = (40, 30)) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A piece of a larger surface, tilted: as a profilometer sees it."""
    piece = periodic((128, 128))[: shape[0], : shape[1]]
    x, y = (np.arange(n) for n in shape)
    return piece + 0.01 * x[:, None] - 0.02 * y


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, Any], Path]:
    """Write bytes, or heights in the format of the name's ending."""

    def write(name: str, content: Any) -> Path:
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif path.suffix == ".npy":
            np.save(path, content)
        else:
            delimiter = {".csv": ",", ".dat": ";"}.get(path.suffix, " ")
            np.savetxt(path, content, delimiter=delimiter, header="heights, in micrometres")
        return path

    return write


def refused(words: str) -> Any:
    return pytest.raises(InvalidScene, match=words)


# ---------------------------------------------------------------- formats


@pytest.mark.parametrize("name", ["map.npy", "map.txt", "map.csv", "map.dat", "MAP.CSV"])
def test_every_format_holds_the_same_heights(write: Any, name: str) -> None:
    surface = HeightsFromFile(write(name, periodic()), (L, 2 * L), unit=1e-6).build()
    # savetxt writes 19 digits; the unit costs a rounding.
    assert np.array_equal(surface.heights, periodic() * 1e-6)
    assert surface.periods == (L, 2 * L)
    line = periodic((64,))
    for written in (line, line[None, :]):  # one column, one row
        path = write(name, written.squeeze() if name.endswith("npy") else written)
        assert np.array_equal(HeightsFromFile(path, (3.0,), unit=1.0).build().heights, line)


@pytest.mark.parametrize(
    ("name", "content", "notes"),
    [
        ("a.csv", b"1.5,2.5,\n3.5,4.5,\n", []),  # each line ends with a separator
        ("b.csv", b"1,5;2,5\n3,5;4,5\n", ["decimal commas"]),
        ("c.txt", b"1,5 2,5\n3,5 4,5\n", ["decimal commas"]),
        ("d.txt", "Höhe in µm\nx y\n1.5\t2.5\n3.5\t4.5\n".encode("latin-1"), ["s: 2", "Latin-1"]),
        ("e.csv", "\ufeffh;h\r\n1.5;2.5\r\n\r\n3.5;4.5 # last\r\n".encode(), ["of heights: 1"]),
        ("f.csv", b"1.5, 2.5\n3.5, 4.5", []),
        # As spreadsheets save "Unicode text".
        ("g.txt", "\ufeffh\n1.5\t2.5\n3.5\t4.5\n".encode("utf-16-le"), ["s: 1", "as UTF-16"]),
    ],
)  # fmt: skip
def test_tables_as_programs_write_them(
    write: Any, name: str, content: bytes, notes: list[str]
) -> None:
    surface = HeightsFromFile(write(name, content), (100.0, 100.0), 1.0, "periodic").build()
    assert np.array_equal(surface.heights, [[1.5, 2.5], [3.5, 4.5]])
    assert len(surface.notes) == len(notes) + 1
    assert all(any(words in note for note in surface.notes) for words in notes)


def test_coordinates_beside_the_heights_are_told(write: Any) -> None:
    column = np.column_stack([np.arange(12) * 0.8, periodic()[:12, :10]])
    both = np.vstack([[np.nan, *range(10)], column])
    for table, parts in ((column, ["column"]), (both, ["column", "line"])):
        path = write("map.csv", table)
        recipe = HeightsFromFile(path, (L, L), 1.0, "periodic", missing="nearest")
        told = [note.split()[2] for note in recipe.build().notes if "even steps" in note]
        assert told == parts


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2", "u1", "?"])
def test_any_real_type_and_order_will_do(write: Any, dtype: str) -> None:
    heights = np.asfortranarray((periodic() * 1000).astype(dtype))
    file = HeightsFromFile(write("map.npy", heights), (1.0, 1.0), unit=1.0).build()
    array = HeightsFromArray(heights, (1.0, 1.0)).build()
    for built in (file, array, Surface(heights, (1.0, 1.0))):
        assert np.array_equal(built.heights, heights.astype(float))
        assert any("in a picture" in note for note in built.notes) is (dtype in ("u1", "?"))


@pytest.mark.parametrize("name", ["map.stl", "binary.stl", "map.ply", "map.vtu"])
def test_meshes_on_a_grid_are_height_maps(tmp_path: Path, name: str) -> None:
    heights = periodic()[:12, :9].astype(np.float32).astype(float)  # the digits of binary .stl
    x, y = np.meshgrid(3 + np.arange(12) * 0.1, np.arange(9) * 0.25 - 7, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), heights.ravel()], axis=1)

    def read(points: Any) -> HeightsFromFile:
        triangles = np.arange(len(points), dtype=np.int32).reshape(3, -1).T
        binary = {"binary": True} if name.startswith("binary") else {}
        meshio.Mesh(points, [("triangle", triangles)]).write(tmp_path / name, **binary)
        return HeightsFromFile(tmp_path / name, unit=1e-3, treatment="periodic")

    recipe = read(points)
    assert recipe.periods == pytest.approx((1.2e-3, 2.25e-3), rel=1e-6)
    assert recipe.build().heights == pytest.approx(1e-3 * heights, rel=1e-14)
    with refused("in which unit its heights are"):
        replace(recipe, unit=None)
    above = np.concatenate([points, points + np.array([0, 0, 5])])
    scattered = points + np.random.default_rng(1).uniform(0, 0.1, points.shape)
    for wrong in (above, scattered, points[:, [2, 0, 1]]):
        with refused(f"{name}: its points are no height map"):
            read(wrong)


def test_periods_by_one_length_or_by_the_pixel(write: Any) -> None:
    square, oblong = write("square.npy", periodic((48, 48))), write("oblong.npy", periodic())
    assert HeightsFromFile(square, (2.0,), unit=1.0).periods == (2.0, 2.0)
    assert HeightsFromFile(oblong, pixel_size=0.5, unit=1.0).periods == (24.0, 25.0)
    changes: list[tuple[dict[str, Any], str]] = [
        ({"periods": (2.0,)}, "48 x 50 .* give both"),
        ({}, "does not say how large"),
        ({"periods": (1.0, 1.0), "pixel_size": 1.0}, "not both"),
        ({"periods": (1.0, 1.0), "unit": None}, "in which unit its heights are; give unit = 1e-6"),
        ({"periods": (1.0, 1.0, 1.0)}, "2 positive lengths"),
    ]
    for arguments, message in changes:
        with refused(message):
            HeightsFromFile(oblong, **({"unit": 1.0} | arguments))
    swapped = HeightsFromFile(oblong, (1.0, 5.0), unit=1e-9).build()
    assert any("wide along x, over 48 lines" in note for note in swapped.notes)


# ---------------------------------------------------------------- identity


def test_the_content_is_the_identity_not_the_place(write: Any) -> None:
    path = write("one.npy", periodic())
    other = path.with_name("other.npy")
    shutil.copy(path, other)
    window = {"treatment": "detrend_and_window"}
    changes: list[dict[str, Any]] = [
        *({"path": write("changed.npy", periodic() + 1e-12)}, {"unit": 1e-6}),
        *({"treatment": "periodic"}, window, window | {"taper": 0.2}),
        *({"form": 1}, {"form": 2}, {"missing": "nearest"}, {"missing": "harmonic"}),
        *({"longest_wavelength": 1.0}, {"shortest_wavelength": 0.1}),
    ]
    recipe = HeightsFromFile(path, (L, L), unit=1.0)
    assert replace(recipe, path=other).fingerprint == recipe.fingerprint
    assert len({r.fingerprint for r in [recipe, *(replace(recipe, **c) for c in changes)]}) == 12
    # It travels to another process without its heights.
    sent = pickle.dumps(recipe)
    arrived = pickle.loads(sent)
    assert len(sent) < 1000 < periodic().nbytes
    assert (arrived, arrived.fingerprint) == (recipe, recipe.fingerprint)
    assert np.array_equal(arrived.build().heights, periodic())


@pytest.mark.parametrize("treatment", ["refuse", "detrend_and_window"])
def test_array_and_file_are_one_surface_and_the_given_array_is_left_alone(
    write: Any, treatment: Any
) -> None:
    given = periodic().copy()
    array = HeightsFromArray(given, (L, L), treatment)
    file = HeightsFromFile(write("a.npy", given), (L, L), unit=1.0, treatment=treatment)
    given[...] = 0
    assert np.array_equal(array.build().heights, file.build().heights)
    assert (array.build().recipe, file.build().recipe) == (array.fingerprint, file.fingerprint)


# ---------------------------------------------------------------- treatment


@pytest.mark.parametrize("shape", [(48, 48), (64,)])
def test_a_periodic_map_passes_wherever_it_is_cut(shape: tuple[int, ...]) -> None:
    for shift in range(0, shape[0], 5):
        moved = np.roll(periodic(shape), (shift,) * len(shape), tuple(range(len(shape))))
        surface = HeightsFromArray(moved, (L,) * len(shape)).build()
        assert np.array_equal(surface.heights, moved)
        assert "rms jump at the edges" in surface.notes[0]
    wall = np.zeros((8, 8))
    wall[:4] = 1.0  # as steep inside as across the edge
    HeightsFromArray(wall, (1.0, 1.0)).build()


def test_a_map_that_is_not_periodic_is_refused_with_its_jump() -> None:
    ramp = np.zeros((20, 10)) + 0.5 * np.arange(20)[:, None]
    jump = r"jump at the edges: 9.5 m across x \(between neighbours at most 0.5 m"
    for heights, message in ((ramp, jump), (cut_out(), "across y"), (np.arange(9.0), "not period")):
        with refused(message):
            HeightsFromArray(heights, (1.0,) * heights.ndim).build()
    taken = HeightsFromArray(cut_out(), (1.0, 1.0), "periodic").build()  # the user's word is taken
    assert np.array_equal(taken.heights, cut_out())
    (edge_x, inner_x), (edge_y, inner_y) = edge_jumps(np.array([[0.0, 3, 4], [1, 3, 8]]))
    assert edge_x == inner_x == pytest.approx(math.sqrt((1 + 0 + 16) / 3))
    assert edge_y == pytest.approx(math.sqrt((16 + 49) / 2))
    assert inner_y == pytest.approx(math.sqrt((1 + 25) / 2))


@pytest.mark.parametrize("shape", [(40, 31), (60,)])
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("hole", [False, True])
def test_a_form_is_all_gone(shape: tuple[int, ...], order: int, hole: bool) -> None:
    grids = np.meshgrid(*(np.arange(n) / 10 for n in shape), indexing="ij")
    form = 3.0 + sum((1 + a) * g for a, g in enumerate(grids)) if order else np.full(shape, 3.0)
    if order == 2:
        form = form + sum((g - 1) ** 2 for g in grids) + math.prod(grids)
    rough = np.random.default_rng(0).standard_normal(shape)
    if hole:
        rough[3:9] = np.nan
    bare = form_removed(rough, order)
    # The form is 40 high at most, so it leaves a few of its roundings.
    assert np.nanmax(np.abs(form_removed(rough + form, order) - bare)) < 1e-12
    if order:
        assert np.nanmax(np.abs(form_removed(form, order - 1))) > 0.1
    # What is left is orthogonal to the form, as least squares leave it.
    assert np.nansum(bare * form) == pytest.approx(0, abs=1e-10)


@pytest.mark.parametrize("method", ["nearest", "harmonic"])
def test_missing_points_are_filled_and_said(write: Any, method: Any) -> None:
    heights, holed = periodic(), periodic().copy()
    holed[5:8, 10:13] = holed[0, 0] = holed[30, 49] = np.nan
    known = np.isfinite(holed)
    for recipe in (
        HeightsFromArray(holed, (L, L), missing=method),
        HeightsFromArray(np.ma.masked_invalid(holed), (L, L), missing=method),
        HeightsFromFile(write("map.npy", holed), (L, L), unit=1.0, missing=method),
    ):
        surface = recipe.build()
        assert np.array_equal(surface.heights[known], heights[known])
        # Heights from elsewhere on the surface would be off by sqrt(2) of its rms height.
        error = (surface.heights - heights)[~known]
        assert np.sqrt(np.mean(error**2)) < heights.std()
        note = f"11 of 2400 heights missing (0.46 %), filled by the method {method}"
        assert note in surface.notes
    for make in (HeightsFromArray, Surface):
        with refused(r'11 of 2400 .* set missing to "harmonic"'):
            make(holed, (L, L))


def test_a_film_over_a_hole_is_harmonic() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(16.0), indexing="ij")
    saddle = x * y + 3 * x  # harmonic on the grid, too
    holed = saddle.copy()
    holed[4:12, 3:9] = np.nan
    assert filled(holed, "harmonic") == pytest.approx(saddle, rel=1e-12)
    assert filled(holed, "nearest")[4, 5] == saddle[3, 5]
    edge = np.array([np.nan, np.nan, 1.0, np.nan, 4.0, np.nan])  # at a right angle to the edge
    assert filled(edge, "harmonic") == pytest.approx([1, 1, 1, 2.5, 4, 4])


def test_waves_outside_a_band_are_removed() -> None:
    x = np.arange(64) * L / 64
    heights = np.cos(x) + np.cos(3 * x) + np.cos(9 * x)
    band = {"longest_wavelength": L / 2, "shortest_wavelength": L / 5}
    surface = HeightsFromArray(heights, (L,), **band).build()
    assert surface.heights == pytest.approx(np.cos(3 * x), abs=1e-14)
    assert "waves longer than 3.14 m and shorter than 1.26 m removed" in surface.notes


@pytest.mark.parametrize("taper", [0.05, 0.1, 0.5])
def test_the_window_keeps_the_rms_slope_and_closes_the_edge(taper: float) -> None:
    heights = cut_out((100, 101))
    recipe = HeightsFromArray(heights, (1.0, 1.0), "detrend_and_window", taper)
    surface = recipe.build()
    slope = rms_slope(form_removed(heights, 1), (1 / 100, 1 / 101))
    assert surface.rms_slope == pytest.approx(slope, rel=1e-12)
    assert surface.heights.mean() == pytest.approx(0, abs=1e-14)
    assert all(edge < 0.2 * inner for edge, inner in edge_jumps(surface.heights))
    jump = edge_jumps(form_removed(heights, 1))[0][0]
    form, window = surface.notes[:2]
    assert form == "least-squares plane removed"
    for words in (f"tapered over {taper:g}", "rms slope", f"{jump:.3g} m", "before", "after"):
        assert words in window
    # mean(w^2) = 1 - 5/4 taper each way of white noise, whose 160,000 samples scatter by 1e-2.
    noise = np.random.default_rng(1).standard_normal((400, 400))
    factor = windowed(noise, taper, (1.0, 1.0))[1]
    assert factor == pytest.approx(1 / (1 - 1.25 * taper), rel=3e-2 * taper)
    # With form 2 the window sees another map.
    assert not np.array_equal(replace(recipe, form=2).build().heights, surface.heights)


# ---------------------------------------------------------------- doubts


@pytest.mark.parametrize("mark", [-9999.0, 1e5])
def test_a_mark_of_missing_points_is_told_from_heights(mark: float) -> None:
    heights = periodic().copy()
    heights[3, 4:9] = mark
    surface = HeightsFromArray(heights, (L, L), treatment="periodic").build()
    assert surface.notes[0].startswith(f"5 heights are {mark:g}, far from all others")
    two_levels = np.where(heights == mark, 1.0, 0.0)  # a post is no mark
    for unmarked in (two_levels, periodic()):
        assert "marks" not in str(HeightsFromArray(unmarked, (L, L)).build().notes)


def test_slopes_beyond_one_are_said_once() -> None:
    """They are a note, and a warning of the line that makes the surface, not of later ones."""
    recipe = HeightsFromArray(periodic() * 1e3, (L, L))
    with pytest.warns(SurfaceWarning) as warned:
        steep = recipe.build()
    told = [note for note in steep.notes if "beyond the small slopes" in note]
    assert [str(one.message) for one in warned] == told
    assert warned[0].filename == __file__
    assert f"the rms slope is {steep.rms_slope:.3g}" in told[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert replace(steep).notes == steep.notes
        assert pickle.loads(pickle.dumps(steep)).notes == steep.notes
        assert one_directional(recipe) is None  # the package builds it and shows the notes itself
        assert HeightsFromArray(periodic() / 10, (L, L)).build().notes[1:] == ()
    picture = (periodic() > 0).astype("u1")
    for build in (lambda: Surface(picture, (L, L)), HeightsFromArray(picture, (L, L)).build):
        with pytest.warns(SurfaceWarning, match="8 bits") as warned:
            build()
        assert {one.filename for one in warned} == {__file__}
        assert sum("8 bits" in str(one.message) for one in warned) == 1


X = np.arange(64.0) - 32
HILLS = np.sin(X[:, None] / 2) + np.cos(X / 3 + 0.4 * X[:, None])


@pytest.mark.parametrize(
    ("heights", "noted"),
    [
        (np.round(8 * HILLS), True),
        (np.round(8 * HILLS).astype(np.float32) * np.float32(0.1), True),
        (np.round(8 * HILLS[3]), True),
        (HILLS, False),
        (np.round(300 * HILLS), False),
        (np.sign(HILLS), False),
        # Treads that are wide, and slopes that rise by one step from each point to the next.
        (np.round(np.sin(2 * np.pi * X / 64)[:, None] + np.sin(2 * np.pi * X / 64)), False),
        (-np.maximum(np.abs(X)[:, None], np.abs(X)), False),
    ],
)
def test_heights_in_steps_that_the_grid_does_not_resolve_are_noted(
    heights: Any, noted: Any
) -> None:
    assert ("are in steps of" in str(Surface(1e-3 * heights, (1.0,) * heights.ndim).notes)) is noted


def test_oblong_cells_are_noted() -> None:
    for ratio, noted in ((1.0, False), (2.0, False), (0.5, False), (2.1, True), (0.01, True)):
        notes = Surface(np.zeros((8, 8)), (ratio, 1.0)).notes
        words = f"the grid's cells are {max(ratio, 1 / ratio):.3g} times as long as wide"
        assert [note.partition(":")[0] for note in notes] == [words] * noted


# ---------------------------------------------------------------- wrong input


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.ones((4, 4)) * 1j, "holds complex values"),
        (np.array([[None, 1], [2, 3]]), "holds object values"),
        (np.array([["1", "2"], ["3", "4"]]), "holds <U1 values"),
        (np.zeros((4, 4), "M8[s]"), r"holds datetime64\[s\] values"),
        (np.zeros(4, [("x", float), ("y", float)]), "values, but heights are real numbers"),
        (np.float64(3), r"shape \(\)"),
        (np.zeros((0, 4)), r"shape \(0, 4\)"),
        (np.zeros((1, 4)), r"shape \(1, 4\)"),
        (np.ones((4, 4, 4)), r"shape \(4, 4, 4\)"),
        ([[1.0, 2.0], [3.0]], "unequal length"),
        (np.full((4, 4), np.nan), "16 of 16 heights are NaN"),
        (np.array([[1, 2], [3, np.inf]]), "1 of 4 heights are infinite"),
        (np.ma.masked_greater(periodic(), 0), "heights are NaN or masked; crop them"),
        (periodic() * 1e41, "heights reach .*; check their unit"),
        (periodic() * 1e-300, "heights span .* less than 1e-40 m; check their unit"),
    ],
)
def test_arrays_that_are_no_heights(write: Any, heights: Any, message: str) -> None:
    for make in (Surface, HeightsFromArray):
        with refused(message):
            make(heights, (1.0, 1.0))
    if isinstance(heights, np.ndarray) and not isinstance(heights, np.ma.MaskedArray):
        with refused(f"{message}|no complete .npy file"):
            HeightsFromFile(write("map.npy", heights), (1.0, 1.0), unit=1.0).build()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"treatment": "window"}, "treatment is 'window', but must be one of refuse, periodic"),
        ({"taper": 0.0}, "taper is 0.0"),
        ({"taper": 0.6}, "taper is 0.6"),
        ({"periods": (L,)}, "2 positive lengths"),
        ({"missing": "linear"}, "missing is 'linear'"),
        ({"form": 3}, "form is 3"),
        ({"longest_wavelength": 0.1, "shortest_wavelength": 1}, "must be below longest_wavelength"),
    ],
)
def test_arrays_with_wrong_words(change: dict[str, Any], message: str) -> None:
    with refused(message):
        replace(HeightsFromArray(periodic(), (L, L)), **change)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Material(1e200, 0.3), r"young_modulus is 1e\+200 Pa, .* between 1e-40 and"),
        (lambda: Load((1.0, 1e99)), r"mean_pressure is 1e\+99 Pa"),
        (lambda: Body("bonded_layer", depth=10**400), "depth is 1000*, but must be a positive"),
        (lambda: Surface(np.ones((4, 4)), (1.0,)), "periods has 1 lengths for heights of 2"),
    ],
)
def test_numbers_whose_squares_are_not_finite_are_refused(make: Any, message: str) -> None:
    with refused(message):
        make()


def npy_with_header(header: str) -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


HUGE = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 1000000000)}"
NO_NPY = "no complete .npy file"
#: What a file holds, and the sentence that refuses it.
BROKEN: list[tuple[str, bytes, str]] = [
    ("empty.npy", b"", "is empty"),
    ("empty.txt", b"", "is empty"),
    ("blank.txt", b"\n\n  \n# only words\n", "no table of numbers"),
    ("huge.npy", npy_with_header(HUGE), NO_NPY),
    ("huger.npy", npy_with_header(HUGE.replace("0)", "0" * 30 + ")")), NO_NPY),
    ("negative.npy", npy_with_header(HUGE.replace("(1", "(-1")), NO_NPY),
    ("short.npy", npy_with_header(HUGE.replace("000000000", "")) + b"\0" * 7, NO_NPY),
    ("header.npy", npy_with_header("{'descr': "), NO_NPY),
    ("code.npy", npy_with_header("__import__('os').system('false')"), NO_NPY),
    ("object.npy", npy_with_header(HUGE.replace("<f8", "|O").replace("000000000", "")), NO_NPY),
    ("pickle.npy", np.array([{"a": 1}, {}], dtype=object).dumps(), NO_NPY),
    ("magic.npy", b"\x93NUM", NO_NPY),
    ("junk.npy", bytes(range(256)) * 8, NO_NPY),
    ("archive.npy", b"PK\x03\x04" + bytes(60), NO_NPY),
    ("junk.txt", bytes(range(256)) * 8, "no table of numbers"),
    ("nul.txt", b"1 2\x003\n\x00\n", "no table of numbers"),
    ("latin.txt", "1 2 µ\n3 4 5".encode("latin-1"), "line 1 holds 'µ'"),
    ("late.txt", b"1 2\n" * 9000 + b"\xff 2\n", "line 9001 holds 'ÿ'"),
    ("words.txt", b"x y\nz t\n", "no line begins with a number"),
    ("ragged.csv", b"1,2\n3\n4,5\n", "line 2 holds 1 numbers, the one above 2"),
    ("points.csv", b"1.5;2,5\n3,5;4,5\n", "line 1 holds '1.5'"),
    ("complex.txt", b"1+2j 2\n3 4\n", "no table of numbers"),
    ("nan.txt", b"1 nan\n3 4\n", "1 of 4 heights are NaN"),
    ("empty.csv", b"1,\n3,4\n", "1 of 4 heights are NaN"),
    ("middle.csv", b"1,2\nsome words,4\n3,4\n", "line 2 holds 'some words'"),
    ("inf.txt", b"1 1e999\n3 4\n", "1 of 4 heights"),
    ("single.txt", b"3\n", r"shape \(1,\)"),
    ("date.txt", b"2026-01-02 12:00\n1 2\n3 4\n", "begin the lines of a header with #"),
    ("xyz.txt", b"X Y Z\n0 0 5\n0 1 7\n1 0 6\n1 1 5\n", "columns are x, y and height"),
    ("junk.vti", b"<VTKFile", "no whole .vti file"),
    *((f"junk.{kind}", b"junk\xff\n", "meshio cannot read") for kind in ("stl", "ply", "vtu")),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "message"), BROKEN, ids=lambda v: str(v)[:12])
def test_broken_files_end_in_one_sentence(
    write: Any, name: str, content: bytes, message: str
) -> None:
    path = write(name, content)
    with refused(message) as caught:
        HeightsFromFile(path, (1.0, 1.0), unit=1.0).build()
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["map.npy", "map.txt", "map.sur", "map.stl"])
def test_missing_files_and_folders(tmp_path: Path, name: str) -> None:
    with refused(f"{name}: no such file"):
        HeightsFromFile(tmp_path / name, (1.0, 1.0))
    (tmp_path / name).mkdir()
    with refused(f"{name}: is a folder"):
        HeightsFromFile(tmp_path / name, (1.0, 1.0))


# ---------------------------------------------------------------- instruments


class Topography:
    """The part of SurfaceTopography's class that is used here, in nanometres."""

    def __init__(
        self, scale: float = 1.0, unit: str | None = "nm", hole: bool = False, uniform: bool = True
    ) -> None:
        self.scale, self.unit, self.hole, self.is_uniform = scale, unit, hole, uniform
        self.physical_sizes = (2e9 * scale, 3e9 * scale)
        self.topography = lambda: self

    def to_unit(self, unit: str) -> Topography:
        return Topography(1e-9, unit, self.hole, self.is_uniform)

    def heights(self) -> Any:
        heights = np.ma.masked_array(self.scale * 1e9 * periodic(), False)
        heights[3, 4] = np.ma.masked if self.hole else heights[3, 4]
        return heights


def test_instrument_files_know_their_size_and_unit(
    write: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write("map.sur", b"DIGITAL SURF")

    def read_by(make: Any) -> None:
        opened = {"open_topography": lambda _: contextlib.nullcontext(make())}
        module: Any = types.SimpleNamespace(**opened)
        monkeypatch.setitem(sys.modules, "SurfaceTopography", module)

    read_by(Topography)
    recipe = HeightsFromFile(path)
    assert recipe.periods == pytest.approx((2.0, 3.0))
    assert recipe.build().heights == pytest.approx(periodic(), rel=1e-14)
    assert HeightsFromFile(path, (5.0, 6.0)).periods == (5.0, 6.0)
    read_by(lambda: Topography(unit=None))
    with_unit = HeightsFromFile(path, (2.0, 3.0), unit=1e-9).build()
    assert with_unit.heights == pytest.approx(periodic(), rel=1e-14)
    read_by(lambda: Topography(hole=True))
    holed = HeightsFromFile(path, missing="nearest").build().heights
    assert holed[3, 4] in (holed[2, 4], holed[4, 4], holed[3, 3], holed[3, 5])
    for reader, options, sentence in (
        (Topography, {"unit": 1e-6}, "knows the unit"),
        (lambda: Topography(unit=None), {}, "in which unit"),
        (lambda: Topography(unit=None), {"unit": 1e-9}, "does not say how large"),
        (lambda: Topography(hole=True), {}, "1 of 2400 heights are NaN or masked"),
        (lambda: Topography(uniform=False), {}, "no regular grid"),
        (lambda: {}["block 3\nof 4"], {}, r"SurfaceTopography cannot read it \('block 3"),
    ):
        read_by(reader)
        with refused(sentence):
            HeightsFromFile(path, **options).build()  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with refused(r"SurfaceTopography; pip install 'epcontact\[instr"):
        HeightsFromFile(path, (1.0, 1.0))


def test_a_real_instrument_file(tmp_path: Path) -> None:
    library = pytest.importorskip("SurfaceTopography", reason="the extra instruments is missing")
    path = tmp_path / "map.nc"
    library.Topography(1e3 * periodic(), (2.0, 3.0), unit="mm").to_netcdf(str(path))
    recipe = HeightsFromFile(path)
    assert recipe.periods == pytest.approx((2e-3, 3e-3))
    assert recipe.build().heights == pytest.approx(periodic(), rel=1e-12)
    path.write_bytes(b"CDF" + bytes(100))
    with refused("SurfaceTopography cannot read it"):
        HeightsFromFile(path)
