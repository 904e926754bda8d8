"""Heights from arrays and files: formats, units, periodicity, and every way to be wrong."""

from __future__ import annotations

import math
import pickle
import shutil
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from epcontact.errors import InvalidScene
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, scene_digest
from epcontact.surfaces import HeightsFromArray, HeightsFromFile, SelfAffine
from epcontact.surfaces.measured import detrended_and_windowed, edge_jumps
from epcontact.surfaces.power_spectrum import surface_moments

L = 2 * math.pi
SPECTRUM = SelfAffineSpectrum(0.8, 1.0, 4.0, 20.0, 0.5)


def periodic(shape: tuple[int, ...] = (48, 50)) -> np.ndarray[Any, np.dtype[np.float64]]:
    return SelfAffine(SPECTRUM, (L,) * len(shape), shape, seed=1).build().heights


def cut_out(shape: tuple[int, int] = (40, 30)) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A piece of a larger surface, tilted: as a profilometer sees it."""
    piece = periodic((128, 128))[: shape[0], : shape[1]]
    x, y = (np.arange(n) for n in shape)
    return piece + 0.01 * x[:, None] - 0.02 * y


def write(folder: Path, name: str, heights: Any) -> Path:
    path = folder / name
    if path.suffix == ".npy":
        np.save(path, heights)
    else:
        delimiter = {".csv": ",", ".dat": ";"}.get(path.suffix, " ")
        np.savetxt(path, heights, delimiter=delimiter, header="heights, in micrometres")
    return path


@pytest.mark.parametrize("name", ["map.npy", "map.txt", "map.csv", "map.dat", "MAP.CSV"])
def test_every_format_holds_the_same_heights(tmp_path: Path, name: str) -> None:
    heights = periodic()
    recipe = HeightsFromFile(write(tmp_path, name, heights), (L, 2 * L), unit=1e-6)
    assert recipe.shape == (48, 50)
    surface = recipe.build()
    # savetxt writes 19 digits; the unit costs a rounding.
    assert np.array_equal(surface.heights, heights * 1e-6)
    assert surface.periods == (L, 2 * L)
    assert not surface.heights.flags.writeable


@pytest.mark.parametrize("name", ["line.npy", "line.txt", "row.csv"])
def test_one_row_or_column_is_a_line(tmp_path: Path, name: str) -> None:
    heights = periodic((64,))
    written = heights[None, :] if name.startswith("row") else heights
    surface = HeightsFromFile(write(tmp_path, name, written), (3.0,)).build()
    assert np.array_equal(surface.heights, heights)


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2", "u1", "?"])
def test_any_real_type_and_order_will_do(tmp_path: Path, dtype: str) -> None:
    heights = np.asfortranarray((periodic() * 1000).astype(dtype))
    surface = HeightsFromFile(write(tmp_path, "map.npy", heights), (1.0, 1.0)).build()
    assert np.array_equal(surface.heights, heights.astype(float))


def test_periods_by_one_length_or_by_the_pixel(tmp_path: Path) -> None:
    square = write(tmp_path, "square.npy", periodic((48, 48)))
    oblong = write(tmp_path, "oblong.npy", periodic())
    assert HeightsFromFile(square, (2.0,)).periods == (2.0, 2.0)
    assert HeightsFromFile(oblong, pixel_size=0.5).periods == (24.0, 25.0)
    for arguments, message in [
        ({"periods": (2.0,)}, "48 x 50 .* give both"),
        ({}, "does not say how large"),
        ({"periods": (1.0, 1.0), "pixel_size": 1.0}, "not both"),
        ({"pixel_size": 0.0}, "pixel_size is 0.0"),
        ({"periods": (1.0, 1.0), "unit": math.nan}, "unit is nan"),
        ({"periods": (1.0, 1.0), "unit": None}, "unit is None"),
        ({"periods": (1.0, 1.0, 1.0)}, "2 positive lengths"),
    ]:
        with pytest.raises(InvalidScene, match=message):
            HeightsFromFile(oblong, **arguments)  # type: ignore[arg-type]


def test_the_content_is_the_identity_not_the_place(tmp_path: Path) -> None:
    path = write(tmp_path, "one.npy", periodic())
    other = tmp_path / "other.npy"
    shutil.copy(path, other)
    changed = write(tmp_path, "changed.npy", periodic() + 1e-12)
    recipe = HeightsFromFile(path, (L, L))
    assert replace(recipe, path=other).fingerprint == recipe.fingerprint
    different = [
        replace(recipe, path=changed),
        replace(recipe, unit=1e-6),
        replace(recipe, treatment="periodic"),
        replace(recipe, treatment="detrend_and_window"),
        replace(recipe, treatment="detrend_and_window", taper=0.2),
    ]
    assert len({r.fingerprint for r in [recipe, *different]}) == 6


def test_a_recipe_travels_to_another_process_without_its_heights(tmp_path: Path) -> None:
    recipe = HeightsFromFile(write(tmp_path, "map.txt", periodic()), (L, L))
    sent = pickle.dumps(recipe)
    assert len(sent) < 1000 < periodic().nbytes
    arrived = pickle.loads(sent)
    assert arrived == recipe
    assert arrived.fingerprint == recipe.fingerprint
    assert np.array_equal(arrived.build().heights, periodic())


@pytest.mark.parametrize("treatment", ["refuse", "detrend_and_window"])
def test_the_digest_is_known_before_the_heights(tmp_path: Path, treatment: Any) -> None:
    material, load = Material(1e9, 0.3), Load(1e5)
    array = HeightsFromArray(periodic(), (L, L), treatment)
    file = HeightsFromFile(write(tmp_path, "a.npy", periodic()), (L, L), treatment=treatment)
    for recipe in (array, file):
        known = scene_digest(
            recipe.fingerprint, recipe.shape, recipe.periods, material, Body(), load
        )
        assert Scene(recipe.build(), material, load).digest == known
    assert np.array_equal(array.build().heights, file.build().heights)


# ---------------------------------------------------------------- periodicity


@pytest.mark.parametrize("shape", [(48, 48), (64,)])
def test_a_periodic_map_passes_wherever_it_is_cut(shape: tuple[int, ...]) -> None:
    heights = periodic(shape)
    for shift in range(0, shape[0], 5):
        moved = np.roll(heights, (shift,) * len(shape), tuple(range(len(shape))))
        surface = HeightsFromArray(moved, (L,) * len(shape)).build()
        assert np.array_equal(surface.heights, moved)
        assert "rms jump at the edges" in surface.notes[0]


def test_a_flat_map_and_a_wall_are_periodic() -> None:
    HeightsFromArray(np.zeros((8, 8)), (1.0, 1.0)).build()
    wall = np.zeros((8, 8))
    wall[:4] = 1.0  # as steep inside as across the edge
    HeightsFromArray(wall, (1.0, 1.0)).build()


def test_a_map_that_is_not_periodic_is_refused_with_its_jump() -> None:
    heights = np.zeros((20, 10)) + 0.5 * np.arange(20)[:, None]
    with pytest.raises(
        InvalidScene, match=r"jump at the edges: 9.5 m across x \(between neighbours at most 0.5 m"
    ):
        HeightsFromArray(heights, (1.0, 1.0)).build()
    with pytest.raises(InvalidScene, match=r"not periodic.* across y"):
        HeightsFromArray(cut_out(), (1.0, 1.0)).build()
    with pytest.raises(InvalidScene, match="not periodic"):
        HeightsFromArray(np.arange(9.0), (1.0,)).build()


def test_the_reader_s_word_is_taken() -> None:
    surface = HeightsFromArray(cut_out(), (1.0, 1.0), "periodic").build()
    assert np.array_equal(surface.heights, cut_out())
    assert "rms jump at the edges" in surface.notes[0]


def test_jumps_are_what_they_are_said_to_be() -> None:
    heights = np.array([[0.0, 3.0, 4.0], [1.0, 3.0, 8.0]])
    (edge_x, inner_x), (edge_y, inner_y) = edge_jumps(heights)
    assert edge_x == inner_x == pytest.approx(math.sqrt((1 + 0 + 16) / 3))
    assert edge_y == pytest.approx(math.sqrt((16 + 49) / 2))
    assert inner_y == pytest.approx(math.sqrt((1 + 25) / 2))


@pytest.mark.parametrize("shape", [(40, 31), (60,)])
@pytest.mark.parametrize("taper", [0.1, 0.5])
def test_a_plane_is_all_gone(shape: tuple[int, ...], taper: float) -> None:
    grids = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    plane = 3.0 + sum((0.1 + 0.2 * a) * g for a, g in enumerate(grids))
    rough = np.random.default_rng(0).standard_normal(shape)
    with_plane, factor = detrended_and_windowed(rough + plane, taper)
    without, same = detrended_and_windowed(rough.copy(), taper)
    # The plane is 10 high, so it leaves a few of its roundings of 2e-15.
    assert np.abs(with_plane - without).max() < 1e-13
    assert factor == pytest.approx(same, rel=1e-13)
    assert np.abs(detrended_and_windowed(plane, taper)[0]).max() < 1e-13


@pytest.mark.parametrize("taper", [0.05, 0.1, 0.5])
def test_the_window_keeps_the_rms_height_and_closes_the_edge(taper: float) -> None:
    heights = cut_out((100, 101))
    columns = [np.ones(heights.size), *(g.ravel() for g in np.indices(heights.shape))]
    fit = np.linalg.lstsq(np.array(columns).T, heights.ravel())[0]
    detrended = heights.ravel() - fit @ np.array(columns)
    surface = HeightsFromArray(heights, (1.0, 1.0), "detrend_and_window", taper).build()
    assert surface.heights.std() == pytest.approx(detrended.std(), rel=1e-12)
    assert surface.heights.mean() == pytest.approx(0, abs=1e-14)
    for edge, inner in edge_jumps(surface.heights):
        assert edge < 0.2 * inner
    assert surface_moments(surface).rms_height == pytest.approx(detrended.std(), rel=1e-12)


def test_the_factor_of_white_noise_is_the_window_s() -> None:
    noise = np.random.default_rng(1).standard_normal((400, 400))
    _, factor = detrended_and_windowed(noise, 0.1)
    # mean(w^2) = 1 - 5/4 taper each way; 160,000 samples scatter by 1e-2 of the difference.
    assert factor == pytest.approx(1 / (1 - 1.25 * 0.1), rel=3e-3)


def test_the_note_says_what_was_done() -> None:
    surface = HeightsFromArray(cut_out(), (1.0, 1.0), "detrend_and_window").build()
    (note,) = surface.notes
    jumps = edge_jumps(cut_out())
    for words in ("plane removed", "tapered over 0.1", f"{jumps[0][0]:.3g} m", "before", "after"):
        assert words in note


def test_the_given_array_is_left_alone() -> None:
    given = cut_out()
    copy = given.copy()
    recipe = HeightsFromArray(given, (1.0, 1.0), "detrend_and_window")
    first = recipe.build().heights
    given[...] = 0
    assert np.array_equal(recipe.build().heights, first)
    assert not np.array_equal(first, copy)


# ---------------------------------------------------------------- wrong input


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.full((4, 4), np.nan), "16 of 16 heights are NaN"),
        (np.array([[1, 2], [3, np.inf]]), "1 of 4 heights"),
        (np.ones((4, 4)) * 1j, "complex"),
        (np.ones((4, 4, 4)), r"shape \(4, 4, 4\)"),
        (np.float64(3), r"shape \(\)"),
        (np.ones((1, 4)), r"shape \(1, 4\)"),
        (np.ones((0, 4)), r"shape \(0, 4\)"),
        ([[1.0, 2.0], [3.0]], "unequal length"),
        ([["a", "b"], ["c", "d"]], "<U1 values"),
        ([[None, 1], [2, 3]], "object values"),
        (np.zeros(4, [("x", float), ("y", float)]), "values, but heights are real numbers"),
    ],
)
def test_arrays_that_are_no_heights(tmp_path: Path, heights: Any, message: str) -> None:
    with pytest.raises(InvalidScene, match=message):
        HeightsFromArray(heights, (1.0, 1.0))
    if isinstance(heights, np.ndarray):
        with pytest.raises(InvalidScene, match=message):
            HeightsFromFile(write(tmp_path, "map.npy", heights), (1.0, 1.0)).build()


def test_arrays_with_wrong_words() -> None:
    good = HeightsFromArray(periodic(), (L, L))
    for change, message in [
        ({"treatment": "window"}, "treatment is 'window'"),
        ({"taper": 0.0}, "taper is 0.0"),
        ({"taper": 0.6}, "taper is 0.6"),
        ({"taper": "much"}, "taper is 'much'"),
        ({"periods": (L,)}, "2 positive lengths"),
    ]:
        with pytest.raises(InvalidScene, match=message):
            replace(good, **change)  # type: ignore[arg-type]


def npy_with_header(header: str) -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


HUGE = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 1000000000)}"
BROKEN_FILES: list[tuple[str, bytes, str]] = [
    ("empty.npy", b"", "is empty"),
    ("empty.txt", b"", "is empty"),
    ("blank.txt", b"\n\n  \n# only words\n", "no table of numbers"),
    ("huge.npy", npy_with_header(HUGE), "no complete .npy file"),
    ("huger.npy", npy_with_header(HUGE.replace("0)", "0" * 30 + ")")), "no complete .npy file"),
    ("negative.npy", npy_with_header(HUGE.replace("(1", "(-1")), "no complete .npy file"),
    ("header.npy", npy_with_header("{'descr': "), "no complete .npy file"),
    ("code.npy", npy_with_header("__import__('os').system('false')"), "no complete .npy file"),
    ("magic.npy", b"\x93NUM", "no complete .npy file"),
    ("junk.npy", bytes(range(256)) * 8, "no complete .npy file"),
    ("archive.npy", b"PK\x03\x04" + bytes(60), "no complete .npy file"),
    ("junk.txt", bytes(range(256)) * 8, "no text in UTF-8"),
    ("nul.txt", b"1 2\x003\n\x00\n", "no table of numbers"),
    ("latin.txt", "1 2 µ\n3 4 5".encode("latin-1"), "no text in UTF-8"),
    ("late.txt", b"1 2\n" * 9000 + b"\xff 2\n", "no text in UTF-8"),
    ("words.txt", b"x y\n1 2\n", "no table of numbers"),
    ("ragged.csv", b"1,2\n3\n", "no table of numbers"),
    ("comma.csv", b"1,5;2,5\n3,5;4,5\n", "no table of numbers"),
    ("complex.txt", b"1+2j 2\n3 4\n", "no table of numbers"),
    ("nan.txt", b"1 nan\n3 4\n", "1 of 4 heights"),
    ("inf.txt", b"1 1e999\n3 4\n", "1 of 4 heights"),
    ("single.txt", b"3\n", r"shape \(1,\)"),
]


@pytest.mark.parametrize(("name", "content", "message"), BROKEN_FILES, ids=lambda v: str(v)[:12])
def test_broken_files_end_in_one_sentence(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InvalidScene, match=message) as caught:
        HeightsFromFile(path, (1.0, 1.0)).build()
    text = str(caught.value)
    assert name in text
    assert "\n" not in text


def test_truncated_and_pickled_npy(tmp_path: Path) -> None:
    path = write(tmp_path, "map.npy", periodic())
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InvalidScene, match=r"no complete \.npy file"):
        HeightsFromFile(path, (L, L))
    np.save(path, np.array([{"a": 1}, {}], dtype=object), allow_pickle=True)
    with pytest.raises(InvalidScene, match=r"no complete \.npy file"):
        HeightsFromFile(path, (L, L))


@pytest.mark.parametrize("name", ["map.npy", "map.txt", "map.sur"])
def test_missing_files_and_folders(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidScene, match=f"{name}: no such file"):
        HeightsFromFile(tmp_path / name, (1.0, 1.0))
    (tmp_path / name).mkdir()
    with pytest.raises(InvalidScene, match=f"{name}: is a folder"):
        HeightsFromFile(tmp_path / name, (1.0, 1.0))


# ---------------------------------------------------------------- instruments


def test_instrument_files_ask_for_their_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    path = tmp_path / "map.sur"
    path.write_bytes(b"DIGITAL SURF")
    with pytest.raises(InvalidScene, match=r"SurfaceTopography; pip install 'epcontact\[instr"):
        HeightsFromFile(path, (1.0, 1.0))


class Topography:
    """As much of SurfaceTopography's class as is used here, in nanometres."""

    unit: str | None = "nm"
    has_undefined_data = False
    is_uniform = True
    physical_sizes: Any = (2e9, 3e9)

    def __init__(self, scale: float = 1.0) -> None:
        self.scale = scale
        self.physical_sizes = tuple(scale * s for s in (2e9, 3e9))

    def to_unit(self, unit: str) -> Topography:
        assert unit == "m"
        return type(self)(1e-9)

    def heights(self) -> Any:
        return self.scale * 1e9 * periodic()


class Undefined(Topography):
    has_undefined_data = True


class Scattered(Topography):
    is_uniform = False


class Unitless(Topography):
    unit = None


def read_by(topography: type[Topography] | Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    class Reader:
        def __enter__(self) -> Reader:
            return self

        def __exit__(self, *_: object) -> None: ...

        def topography(self) -> Topography:
            if isinstance(topography, Exception):
                raise topography
            return topography()

    module = types.SimpleNamespace(open_topography=lambda _: Reader())
    monkeypatch.setitem(sys.modules, "SurfaceTopography", module)  # type: ignore[arg-type]


def test_instrument_files_know_their_size_and_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.sur"
    path.write_bytes(b"DIGITAL SURF")
    read_by(Topography, monkeypatch)
    recipe = HeightsFromFile(path)
    assert recipe.periods == pytest.approx((2.0, 3.0))
    assert recipe.build().heights == pytest.approx(periodic(), rel=1e-14)
    assert HeightsFromFile(path, (5.0, 6.0)).periods == (5.0, 6.0)
    with pytest.raises(InvalidScene, match="knows the unit"):
        HeightsFromFile(path, unit=1e-6)
    read_by(Unitless, monkeypatch)
    with pytest.raises(InvalidScene, match="does not say how large"):
        HeightsFromFile(path)
    with_unit = HeightsFromFile(path, (2.0, 3.0), unit=1e-9).build()
    assert with_unit.heights == pytest.approx(periodic(), rel=1e-14)
    for broken, message in [
        (Undefined, "points without a height"),
        (Scattered, "no regular grid"),
        (KeyError("block 3\nof 4"), r"SurfaceTopography cannot read it \('block 3"),
    ]:
        read_by(broken, monkeypatch)  # type: ignore[arg-type]
        with pytest.raises(InvalidScene, match=message):
            HeightsFromFile(path)


def test_a_real_instrument_file(tmp_path: Path) -> None:
    library = pytest.importorskip("SurfaceTopography", reason="the extra instruments is missing")
    path = tmp_path / "map.nc"
    sizes = (2.0, 3.0)
    library.Topography(1e3 * periodic(), sizes, unit="mm").to_netcdf(str(path))
    recipe = HeightsFromFile(path)
    assert recipe.periods == pytest.approx((2e-3, 3e-3))
    assert recipe.build().heights == pytest.approx(periodic(), rel=1e-12)
    path.write_bytes(b"CDF" + bytes(100))
    with pytest.raises(InvalidScene, match="SurfaceTopography cannot read it"):
        HeightsFromFile(path)
