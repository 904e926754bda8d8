"""Heights from arrays and files: formats, units, periods, and what is refused."""

import contextlib
import math
import pickle
import sys
import types
import zipfile
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import meshio
import numpy as np
import pytest

from epcontact.errors import InvalidScene
from epcontact.scene import SelfAffineSpectrum, Surface
from epcontact.surfaces import (
    HeightsFromArray,
    HeightsFromFile,
    SelfAffine,
    map_errors,
)

# The heights are about as large as the period, which changes nothing in these tests.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

L = 2 * math.pi
X = np.arange(64.0) - 32
HILLS = np.sin(X[:, None] / 2) + np.cos(X / 3 + 0.4 * X[:, None])
SPECTRUM = SelfAffineSpectrum(0.8, 1.0, 4.0, 20.0, 0.5)
#: A periodic map of unequal sides.
MAP = SelfAffine(SPECTRUM, (L, L), (48, 50), seed=1).build().heights
DELIMITERS = {".csv": ",", ".dat": ";"}


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a file and returns its path.

    The function takes a file name and its content: bytes, or heights [x, y], which are
    written as such to .npy and as a picture [y, x] to the format of another ending.
    """

    def write(name, content):
        """Write the content to a file of this name and return its path."""
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif path.suffix == ".npy":
            np.save(path, content)
        else:
            delimiter = DELIMITERS.get(path.suffix, " ")
            header = "heights"
            np.savetxt(path, np.transpose(content), delimiter=delimiter, header=header)
        return path

    return write


def refused(words):
    """Return a context in which InvalidScene must be raised with a message that matches
    `words`, a regular expression.
    """
    return pytest.raises(InvalidScene, match=words)


# --- formats --------------------------------------------------------------------------


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
    """Binary and text files give the same heights and periods.

    `name` ends in the format, `kind` is the numpy type of the values, which are in
    micrometres.
    """
    heights = np.asfortranarray((1e3 * MAP).astype(kind))
    surface = HeightsFromFile(write(name, heights), (L, 2 * L), 1e-6, "refuse").build()
    assert np.array_equal(surface.heights, heights * 1e-6)
    assert surface.periods == (L, 2 * L)
    note = "along the first index" if name == "a.npy" else "as in its picture"
    assert note in str(surface.notes)


def test_an_array_and_its_file_are_one_surface(write):
    """An array, its .npy file and its table of rows after `transpose` are one surface
    with the same periods.
    """
    surface = HeightsFromArray(MAP, (L, 2 * L), "refuse").build()
    table = write("rows.txt", MAP.T)
    for path, transpose in ((write("a.npy", MAP), False), (table, True)):
        recipe = HeightsFromFile(path, (L, 2 * L), 1.0, "refuse", transpose=transpose)
        read = recipe.build()
        assert np.array_equal(read.heights, surface.heights)
        assert read.rms_slope == surface.rms_slope
    assert "transpose exchanged x and y; before, x runs along" in str(read.notes)


def test_transpose_exchanges_the_lengths_of_a_file(write):
    """The lengths that a header states are exchanged with x and y, and the fingerprint
    differs.  A line cannot be transposed.
    """
    header = b"# Width: 6 m\n# Height: 4 m\n# Value units: m\n"
    recipe = HeightsFromFile(write("a.txt", header + b"0 1 2\n3 4 5\n"))
    other = replace(recipe, periods=(), transpose=True)
    assert other.shape == recipe.shape[::-1] == (2, 3)
    assert other.periods == recipe.periods[::-1] == (4.0, 6.0)
    assert other.fingerprint != recipe.fingerprint
    with refused("holds a line; leave out transpose"):
        HeightsFromFile(write("line.npy", MAP[0]), (L,), 1.0, transpose=True)


@pytest.mark.parametrize(
    ("name", "content"),
    [("row.npy", MAP[3]), ("row.txt", MAP[3][:, None]), ("column.txt", MAP[3])],
)
def test_a_row_or_a_column_is_a_line(write, name, content):
    """A file with a single row or column of heights (`content`) is a line with one
    period, here 3 m.
    """
    recipe = HeightsFromFile(write(name, content), (3.0,), 1.0, "refuse")
    assert np.array_equal(recipe.build().heights, MAP[3])


@pytest.mark.parametrize(
    ("name", "content", "notes"),
    [
        ("a.csv", b"1.5,2.5,\n3.5,4.5,\n", []),  # each line ends with a separator
        ("a.txt", b"1.5, 2.5\n3.5, 4.5\n", []),
        ("b.csv", b"1,5;2,5\n3,5;4,5\n", ["decimal commas"]),
        ("c.txt", b"1,5 2,5\n3,5 4,5\n", ["decimal commas"]),
        (
            "d.txt",
            "Höhe in Bildern\nx y\n1.5\t2.5\n3.5\t4.5\n".encode("latin-1"),
            ["of heights: 2", "Latin-1"],
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
            ["of heights: 1", "as UTF-16"],
        ),
    ],
)
def test_tables_as_programs_write_them(write, name, content, notes):
    """Separators, decimal commas, headers and encodings of instruments and spreadsheets
    are read, and each of `notes` is part of the surface's notes.
    """
    path = write(name, content)
    surface = HeightsFromFile(path, (100.0, 100.0), 1.0, "periodic").build()
    assert np.array_equal(surface.heights, [[1.5, 3.5], [2.5, 4.5]])
    text = "; ".join(surface.notes)
    assert all(words in text for words in notes)


def test_commas_that_separate_and_are_decimal_are_refused(write):
    """A table whose commas are separators and decimal commas at once is refused, but
    integers between commas are read.
    """
    lines = []
    for row in MAP[:9, :8]:
        lines.append(",".join(f"{value:.3f}".replace(".", ",") for value in row))
    with refused("its commas separate the numbers and are decimal commas"):
        HeightsFromFile(write("map.csv", "\n".join(lines).encode()), (L, L), 1.0)
    integers = write("integers.csv", b"10,20,3,40\n5,60,7,80\n9,10,11,12\n")
    assert HeightsFromFile(integers, (400.0, 300.0), 1.0).shape == (4, 3)


def test_coordinates_beside_the_heights_are_noted(write):
    """A first column and a first line with even steps are noted as likely
    coordinates.
    """
    table = np.column_stack([np.arange(12) * 0.8, MAP[:12, :10]])
    path = write("map.csv", np.vstack([[np.nan, *range(10)], table]))
    recipe = HeightsFromFile(path, (L, L), 1.0, "periodic", missing="nearest")
    notes = [note for note in recipe.build().notes if "even steps" in note]
    assert [note.split()[2] for note in notes] == ["column", "line"]


def test_a_plane_is_not_taken_for_coordinates(write):
    """A tilted plane, all of whose columns have even steps, gets no note about
    coordinates.
    """
    plane = write("plane.csv", np.add.outer(np.arange(12.0), 2.0 * np.arange(10)))
    assert "even steps" not in str(HeightsFromFile(plane, (L, L), 1.0).build().notes)


def test_steps_that_a_number_cannot_hold_are_no_coordinates(write):
    """Heights whose differences overflow are refused for their size, without a warning
    of numpy.
    """
    huge = np.array([-9.24e307, 9.24e307])[np.arange(12 * 9).reshape(12, 9) % 2]
    with refused("heights reach"):
        HeightsFromFile(write("huge.csv", huge), (L, L), 1.0, "periodic").build()


# --- points on a grid -----------------------------------------------------------------

#: Heights of a grid of points with the digits of a binary .stl file.
PIECE = MAP[:12, :9].astype(np.float32).astype(float)
POINTS = np.stack(
    [
        np.repeat(3 + np.arange(12) * 0.1, 9),
        np.tile(np.arange(9) * 0.25 - 7, 12),
        PIECE.ravel(),
    ],
    axis=1,
)
MESHES = ["binary.stl", "map.ply", "map.vtu"]


def recipe_of_mesh(path, points):
    """Write points (n, 3) as a mesh of triangles to `path`, and return the recipe that
    reads the mesh in millimetres.
    """
    triangles = np.arange(len(points), dtype=np.int32).reshape(3, -1).T
    options = {"binary": True} if path.name.startswith("binary") else {}
    meshio.Mesh(points, [("triangle", triangles)]).write(path, **options)
    return HeightsFromFile(path, unit=1e-3, treatment="periodic", form=0)


@pytest.mark.parametrize("name", MESHES)
def test_meshes_on_a_grid_are_height_maps(tmp_path, name):
    """A mesh whose points lie on a 12 x 9 grid is a map with the periods of the grid
    and its heights less their mean.
    """
    recipe = recipe_of_mesh(tmp_path / name, POINTS)
    assert recipe.periods == pytest.approx((1.2e-3, 2.25e-3), rel=1e-6)
    expected = 1e-3 * (PIECE - PIECE.mean())
    assert recipe.build().heights == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize(
    "points",
    [
        np.concatenate([POINTS, POINTS + np.array([0, 0, 5])]),  # one above the other
        POINTS + np.random.default_rng(1).uniform(0, 0.1, POINTS.shape),
        POINTS[:, [2, 0, 1]],
    ],
)
def test_meshes_on_no_grid_are_refused(tmp_path, name, points):
    """Points above each other, at random places, or with exchanged coordinates are
    refused.
    """
    with refused(f"{name}: its points are no height map"):
        recipe_of_mesh(tmp_path / name, points)


def text_of(points):
    """Return points (n, 3) as the bytes of a table with one point a line."""
    return "\n".join(",".join(map(repr, row)) for row in points.tolist()).encode()


@pytest.mark.parametrize(
    ("name", "missing"),
    [("complete.xyz", 0), ("complete.csv", 0), ("gaps.xyz", 30), ("gaps.txt", 30)],
)
def test_lists_of_points_are_maps(write, name, missing):
    """A list of points in any order is a map; `missing` of its 108 points are left out
    and filled in.
    """
    listed = np.random.default_rng(3).permutation(POINTS)[missing:]
    path = write(name, b"X, Y, Z\n" + text_of(listed))
    recipe = HeightsFromFile(
        path, unit=1e-6, treatment="periodic", missing="nearest", form=0
    )
    assert recipe.shape == (12, 9)
    assert recipe.periods == pytest.approx((1.2e-6, 2.25e-6), rel=1e-12)
    surface = recipe.build()
    measured = np.isin(PIECE, listed[:, 2])
    expected = 1e-6 * (PIECE[measured] - listed[:, 2].mean())
    assert surface.heights[measured] == pytest.approx(expected, abs=1e-18)
    count = f"{missing} of 108 heights missing"
    assert any(count in note for note in surface.notes) == (missing > 0)
    assert "its columns are x, y and height" in surface.notes
    assert "the unit of its lengths; it was taken to be 1e-06 m" in str(surface.notes)


def test_lists_of_points_may_mark_missing_heights(write):
    """A word in the place of a height marks the point as missing."""
    path = write("marked.xyz", b"0 0 No Data\n0 1 2\n1 0 3\n1 1 4\n")
    assert HeightsFromFile(path, unit=1.0, missing="nearest").shape == (2, 2)


def test_a_list_of_less_than_half_of_the_points_is_refused(write):
    """A list that holds fewer than half of the points of its grid is refused."""
    path = write("sparse.xyz", text_of(POINTS[::2][:-5]))
    with refused("sample them on a grid first"):
        HeightsFromFile(path, unit=1e-6)


# --- instruments ----------------------------------------------------------------------


@dataclass
class Topography:
    """Those attributes of the topographies of SurfaceTopography that the reader uses.

    `unit` is the name of the length unit, `hole` the mask of missing heights, and
    `scale` the number of units in a metre. The map has periods of 2 m and 3 m.
    """

    unit: str | None = "nm"
    hole: Any = False
    is_uniform: bool = True
    scale: float = 1e9

    @property
    def physical_sizes(self):
        """Return both periods in the topography's unit."""
        return 2 * self.scale, 3 * self.scale

    def heights(self):
        """Return the map in the topography's unit, masked where it has holes."""
        return np.ma.masked_array(self.scale * MAP, self.hole)


@dataclass
class Channel:
    """A channel of a file, as SurfaceTopography describes it.

    `name` is its name, `create` a function that returns its topography, and `data_unit`
    the unit of its values; the channel holds heights if this is None.
    """

    name: str
    create: Any
    data_unit: str | None = None
    nb_grid_pts = MAP.shape

    @property
    def is_uniform(self):
        """Return True if the points of the topography have even steps."""
        return self.create().is_uniform

    @property
    def physical_sizes(self):
        """Return the lengths of the topography, None if it has no unit."""
        topography = self.create()
        has_lengths = topography.unit is not None and topography.is_uniform
        return topography.physical_sizes if has_lengths else None

    @property
    def is_height_channel(self):
        """Return True if the channel holds heights."""
        return self.data_unit is None

    def topography(self, physical_sizes):
        """Return the topography; a file without lengths needs some to be read."""
        needs_lengths = self.physical_sizes is None and self.is_uniform
        if needs_lengths == (physical_sizes is None):
            raise ValueError("lengths are given twice or not at all")
        return self.create()


class Trace(Topography):
    """The line of the heights HILLS[0] in nm, whose points have uneven steps."""

    def positions(self):
        """Return x of the points, which are three steps longer than their number."""
        return np.delete(np.arange(67.0), [5, 40, 41])

    def heights(self):
        """Return the heights of the points."""
        return HILLS[0]


def unreadable_topography():
    """Raise KeyError with two lines, as SurfaceTopography does for a file that it
    cannot read.
    """
    raise KeyError("tried XYZReader:\n no grid")


def format_reader(ending, magic, opened):
    """Return a reader of SurfaceTopography for files of one ending.

    `magic` are the first bytes of its files, b"" if it accepts any, and `opened` is
    what it opens: a list of channels, of which the first is the default, or an error.
    """

    def can_read(content):
        """Return whether the format begins with these bytes."""
        word = "maybe" if content.startswith(magic) else "no"
        return types.SimpleNamespace(value=word)

    return types.SimpleNamespace(
        file_extensions=lambda: [ending],
        format=lambda: ending,
        name=ending.upper,
        can_read=can_read,
        opened=opened,
    )


@pytest.fixture
def with_readers(monkeypatch):
    """Return a function that replaces SurfaceTopography by a library that has the given
    readers.
    """

    def replace_library(*readers):
        """Install a library with these readers, from `format_reader`."""

        def open_topography(_, **options):
            """Return a context with the reader of this format, or raise its error."""
            (opened,) = [r.opened for r in readers if r.format() == options["format"]]
            if isinstance(opened, Exception):
                raise opened
            default = opened[0] if opened else None
            reader = types.SimpleNamespace(channels=opened, default_channel=default)
            return contextlib.nullcontext(reader)

        library = types.SimpleNamespace(
            open_topography=open_topography, readers=readers
        )
        module: Any = types.SimpleNamespace(IO=library)
        monkeypatch.setitem(sys.modules, "SurfaceTopography", module)

    return replace_library


@pytest.fixture
def instrument(write, with_readers):
    """Return a function that gives the recipe of an instrument's file.

    The function takes a function that returns the topography, which stands in for
    SurfaceTopography's reader, and the options of the recipe.
    """
    path = write("map.sur", b"DIGITAL SURF")

    def recipe(topography, **options):
        """Return the recipe of map.sur, whose reader returns `topography()`."""
        try:
            topography()
            opened = [Channel("Height", topography)]
        except KeyError as error:
            opened = error
        with_readers(format_reader("sur", b"DIGITAL", opened))
        return HeightsFromFile(path, **{"treatment": "refuse"} | options)

    return recipe


def test_instrument_files_give_their_size_and_unit(instrument):
    """The file's periods and unit are used, and periods that the user gives must agree
    with those of the file or be accepted.
    """
    recipe = instrument(Topography)
    assert recipe.periods == pytest.approx((2.0, 3.0))
    assert recipe.build().heights == pytest.approx(MAP, rel=1e-14)
    assert instrument(Topography, periods=(2.001, 3.0), unit=1e-9).periods[0] == 2.001
    with refused(r"states lengths of 2e\+09, 3e\+09 .* but period = \[5.0, 6.0\] m is"):
        instrument(Topography, periods=(5.0, 6.0))
    recipe = instrument(Topography, periods=(5.0, 6.0), accept=("size",))
    assert recipe.periods == (5.0, 6.0)


def test_instrument_files_without_a_unit_take_that_of_the_user(instrument):
    """A file without a unit is read with the periods and the unit that the user
    gives.
    """
    recipe = instrument(partial(Topography, None), periods=(2.0, 3.0), unit=1e-9)
    assert recipe.build().heights == pytest.approx(MAP, rel=1e-14)


@pytest.mark.parametrize(
    ("topography", "options", "message"),
    [
        (Topography, {"unit": 1e-6}, "states 1e-09 m .* unit is nm.*unit = 1e-06 is"),
        (partial(Topography, None), {}, "in which unit"),
        (partial(Topography, None), {"unit": 1e-9}, "does not say how large"),
        (partial(Topography, hole=MAP > 0), {}, "of 2400 heights are NaN or masked"),
        (partial(Topography, is_uniform=False), {}, "no regular grid"),
        (
            unreadable_topography,
            {},
            r"SUR files .*KeyError \(.*XYZReader.*; export the .* as \.x3p,",
        ),
    ],
)
def test_instrument_files_are_refused(instrument, topography, options, message):
    """A contradictory or incomplete file of an instrument is refused.

    `topography` is the function that returns what the file holds, `options` are those
    of the recipe, and `message` is a pattern of the error.
    """
    with refused(message):
        instrument(topography, **options).build()


def test_instrument_files_need_surface_topography(write, monkeypatch):
    """Without SurfaceTopography the message names the command that installs it."""
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    with refused(r"SurfaceTopography; pip install 'epcontact\[instr"):
        HeightsFromFile(write("map.sur", b"DIGITAL SURF"), (1.0, 1.0))


CHANNELS = [
    Channel("Phase", Topography, "deg"),
    Channel("Height#1", Topography),
    Channel("Height#2", partial(Topography, hole=np.arange(2400).reshape(48, 50) == 7)),
]


def test_a_channel_is_chosen_by_its_name(write, with_readers):
    """The first channel of heights is read, or that whose name is given, and a note
    lists all.
    """
    with_readers(format_reader("nid", b"AFM", CHANNELS))
    recipe = HeightsFromFile(write("a.nid", b"AFM"), treatment="periodic")
    listed = 'of "Phase", "Height#1", "Height#2"'
    assert f'the channel "Height#1" was read, {listed}' in recipe.build().notes
    other = replace(recipe, channel="Height#2", missing="harmonic")
    assert f'the channel "Height#2" was read, {listed}' in other.build().notes
    assert other.fingerprint != replace(recipe, missing="harmonic").fingerprint
    with refused(f'has no channel "Depth"; set channel to one {listed}'):
        replace(recipe, channel="Depth")
    with refused('its channel "Phase" is in deg and holds no heights; set channel to'):
        replace(recipe, channel="Phase")
    with refused(r"\.txt files have no channels; leave out channel"):
        HeightsFromFile(write("a.txt", MAP), (L, L), 1.0, channel="Height")


def test_a_file_that_states_no_size_takes_the_pixel_size(instrument):
    """The reader of a file without lengths gets some, and those of the user count."""
    recipe = instrument(partial(Topography, None), pixel_size=0.5, unit=1e-9)
    assert recipe.periods == (24.0, 25.0)


def test_a_trace_of_uneven_steps_is_a_line(instrument):
    """A line with uneven steps has the length of its x, and missing steps are holes."""
    trace = partial(Trace, is_uniform=False)
    recipe = instrument(trace, treatment="periodic", missing="nearest")
    assert recipe.shape == (67,)
    assert recipe.periods == pytest.approx((67e-9,))
    assert list(np.flatnonzero(recipe.build().filled)) == [5, 40, 41]


def test_the_reason_is_that_of_the_reader_of_the_ending(write, with_readers):
    """A file is read by its ending's reader, or by one that recognises its content.
    The message has the reason of its ending's reader.
    """
    path = write("a.opd", b"OPD0")
    broken = format_reader("opd", b"OPD", ValueError("its block is cut"))
    any_file = format_reader("nms", b"", [Channel("Height", Topography)])
    with_readers(any_file, format_reader("gwy", b"GWY", ValueError("no")), broken)
    with refused(
        r"the reader of OPD files cannot read it \(its block is cut\); export"
    ):
        HeightsFromFile(path)
    with refused("no reader knows the ending .opx, and none recognises its content"):
        HeightsFromFile(write("a.opx", b"OPX0"))
    with_readers(any_file, format_reader("gwy", b"OP", CHANNELS), broken)
    assert HeightsFromFile(path).shape == (48, 50)
    with_readers(format_reader("dat", b"\x88", [Channel("Height", Topography)]))
    assert HeightsFromFile(write("a.dat", b"\x88\0\1")).shape == (48, 50)


def test_compressed_files_are_to_be_unpacked(tmp_path, write):
    """A compressed file is refused with the files inside, if these can be listed."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("maps/a.txt", "1 2")
    with refused(r"a.zip: is a compressed file; unpack it .* \(maps/a.txt\)"):
        HeightsFromFile(tmp_path / "a.zip")
    with refused("a.txt.gz: is a compressed file; unpack it"):
        HeightsFromFile(write("a.txt.gz", b"\x1f\x8b\x08"))


def test_a_zip_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    """An archive that would unpack to more than the limit, here 1 MiB, is refused."""
    monkeypatch.setattr(map_errors, "_UNPACKED", 2**20)
    path = tmp_path / "bomb.x3p"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.bin", bytes(2**21))
    with refused("bomb.x3p: unpacks from 0.00.* MiB to 2 MiB"):
        HeightsFromFile(path, (1.0, 1.0))


# --- units and periods ----------------------------------------------------------------


@pytest.fixture
def map_file(write):
    """Return the path of the periodic 48 x 50 map as a .npy file."""
    return write("map.npy", MAP)


def test_periods_by_one_length_or_by_the_pixel(write, map_file):
    """One period holds for both sides of a square map, and a pixel size gives the
    periods of any map.
    """
    square = write("square.npy", MAP[:, :48])
    assert HeightsFromFile(square, (2.0,), unit=1.0).periods == (2.0, 2.0)
    assert HeightsFromFile(map_file, pixel_size=0.5, unit=1.0).periods == (24.0, 25.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"periods": (2.0,)}, "48 x 50 .* give both"),
        ({}, "does not say how large"),
        ({"periods": (1.0, 1.0), "pixel_size": 1.0}, "not both"),
        ({"periods": (1.0, 1.0), "unit": None}, "its heights are; give unit = 1e-6"),
        ({"periods": (1.0, 1.0, 1.0)}, "2 positive lengths"),
    ],
)
def test_periods_or_units_that_are_no_such_are_refused(map_file, arguments, message):
    """Missing, contradictory or superfluous periods and a missing unit are refused.

    `arguments` are options of the recipe, and `message` is a pattern of the error.
    """
    with refused(message):
        HeightsFromFile(**{"path": map_file, "unit": 1.0} | arguments)


def test_what_is_no_file_is_refused(tmp_path):
    """A folder and a path without a file are refused."""
    with refused("is a folder"):
        HeightsFromFile(tmp_path, (1.0, 1.0), 1.0)
    with refused(r"none\.npy: no such file"):
        HeightsFromFile(tmp_path / "none.npy", (1.0, 1.0), 1.0)


@pytest.fixture
def with_slope(map_file):
    """Return a function that takes an rms slope and returns the recipe of the map with
    the unit that gives it this slope.
    """

    def recipe(unit, **options):
        """Return the recipe of the map in a unit of heights in m, with 1 m between
        points.
        """
        return HeightsFromFile(map_file, pixel_size=1.0, unit=unit, form=0, **options)

    slope_of_map = recipe(1.0).build().rms_slope
    return lambda slope, **options: recipe(slope / slope_of_map, **options)


def test_a_slope_of_no_surface_is_refused(with_slope):
    """An rms slope above 10 is refused as a wrong unit, and a slope of 9 is
    accepted.
    """
    with refused("npy: the rms slope is 11, beyond that of any surface; .* check unit"):
        with_slope(11.0).build()
    assert with_slope(9.0).build().rms_slope == pytest.approx(9)


@pytest.mark.parametrize("slope", [0.9e-4, 11.0])
def test_a_slope_of_no_surface_can_be_accepted(with_slope, slope):
    """An rms slope below 1e-4, which only optical flats have, or above 10 is refused
    unless `accept` names the slope, and then noted.
    """
    assert with_slope(1.1e-4).build().rms_slope == pytest.approx(1.1e-4)
    with refused(f"the rms slope is {slope:g}, .*check unit, .*accept = .*slope"):
        with_slope(slope).build()
    surface = with_slope(slope, accept=("slope",)).build()
    assert f"the rms slope is {slope:g}, " in surface.notes[-1]
    with refused("accept is 'tilt', but must be one of slope, unit, size"):
        with_slope(slope, accept=("tilt",))


def test_a_slope_of_no_surface_is_refused_with_marks_that_may_cause_it(write):
    """If the steep slope may come from marks of missing heights, such as -9999, the
    message names the mark and its count.
    """
    marked = np.where(np.arange(MAP.size).reshape(MAP.shape) % 400 < 2, -9999.0, MAP)
    recipe = HeightsFromFile(write("marks.txt", marked), pixel_size=1.0, unit=2.0)
    with refused("check unit, .*; or 12 heights are -9999, far from all others"):
        recipe.build()


# --- identity -------------------------------------------------------------------------


def test_the_content_identifies_a_map_and_not_its_path(write, map_file):
    """The fingerprint of a file's recipe depends on its heights and not on its path."""
    recipe = HeightsFromFile(map_file, (L, L), 1.0, "refuse")
    other = write("other.npy", MAP)
    changed = write("changed.npy", MAP + 1e-12)
    assert replace(recipe, path=other).fingerprint == recipe.fingerprint
    assert replace(recipe, path=changed).fingerprint != recipe.fingerprint


def test_every_treatment_is_in_the_fingerprint(map_file):
    """Each option of the treatment changes the fingerprint."""
    recipe = HeightsFromFile(map_file, (L, L), 1.0, "refuse")
    changes: list[dict[str, Any]] = [
        {},
        {"unit": 1e-6},
        {"treatment": "periodic"},
        {"treatment": "mirrored"},
        {"form": 1},
        {"form": 2},
        {"missing": "nearest"},
        {"missing": "harmonic"},
        {"outliers": "remove"},
        {"longest_wavelength": 1.0},
        {"shortest_wavelength": 0.1},
    ]
    fingerprints = {replace(recipe, **change).fingerprint for change in changes}
    assert len(fingerprints) == len(changes)


def test_a_recipe_travels_without_its_heights(map_file):
    """A pickled recipe holds less than 1000 bytes, and reads the heights again where it
    arrives.
    """
    recipe = HeightsFromFile(map_file, (L, L), 1.0, "refuse")
    sent = pickle.dumps(recipe)
    assert len(sent) < 1000 < MAP.nbytes
    arrived = pickle.loads(sent)
    assert arrived == recipe
    assert arrived.fingerprint == recipe.fingerprint
    assert np.array_equal(arrived.build().heights, MAP)


def test_an_array_is_copied(map_file):
    """A recipe of an array keeps its heights after the array is overwritten."""
    given = MAP.copy()
    recipe = HeightsFromArray(given, (L, L))
    given[...] = 0
    surface = recipe.build()
    assert np.array_equal(surface.heights, MAP)
    assert surface.recipe == recipe.fingerprint


# --- refusals -------------------------------------------------------------------------

GOOD = HeightsFromArray(HILLS, (1e3, 1e3), "periodic")


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.array([["1", "2"], ["3", "4"]]), "holds <U1 values"),
        (np.float64(3), r"shape \(\)"),
        (np.ones((4, 4, 4)), r"shape \(4, 4, 4\)"),
        ([[1.0, 2.0], [3.0]], "unequal length"),
        (np.array([[1, 2], [3, np.inf]]), "1 of 4 heights are infinite"),
        (np.ma.masked_greater(HILLS, 1), 'NaN or masked; .*set missing to "harmonic"'),
        (HILLS * 1e41, "heights reach .*; check their unit"),
        (HILLS * 1e-300, "heights span .* less than 1e-40 m; check their unit"),
    ],
    ids=lambda value: str(value)[:12],
)
def test_what_is_no_height_map_is_refused(heights, message):
    """Values that are no 1D or 2D array of finite, plausible heights in m are refused
    with a matching message.
    """
    with refused(message):
        replace(GOOD, heights=heights)
    with refused(message):
        Surface(heights, (1.0, 1.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"treatment": "window"}, "is 'window', but must be one of mirrored, periodic"),
        ({"periods": (L,)}, "2 positive lengths"),
        ({"form": 3}, "form is 3"),
        (
            {"longest_wavelength": 0.1, "shortest_wavelength": 1},
            "must be below longest_wavelength",
        ),
    ],
)
def test_what_is_no_treatment_is_refused(change, message):
    """An invalid treatment, period, form or wavelength is refused.

    `change` replaces options of a valid recipe, and `message` is a pattern of the
    error.
    """
    with refused(message):
        replace(GOOD, **change)


#: The header of a .npy file of 1e18 numbers.
HUGE = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 1000000000)}\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.txt", b"", "is empty"),
        ("huge.npy", b"\x93NUMPY\x01\x00L\x00" + HUGE.encode(), "no complete .npy"),
        ("complex.npy", np.ones((4, 4)) * 1j, "holds complex values"),
        ("pickle.npy", pickle.dumps(np.array([{"a": 1}, {}])), "no complete .npy"),
        ("junk.txt", bytes(range(256)) * 8, "no table of numbers"),
        ("late.txt", b"1 2\n" * 9000 + b"\xff 2\n", "line 9001 holds 'ÿ'"),
        ("words.txt", b"x y\nz t\n", "no line begins with a number"),
        ("ragged.csv", b"1,2\n3\n4,5\n", "line 2 holds 1 numbers, the one above 2"),
        ("points.csv", b"1.5;2,5\n3,5;4,5\n", "line 1 holds '1.5'"),
        ("middle.csv", b"1,2\nsome words,4\n3,4\n", "line 2 holds 'some words'"),
        ("nan.txt", b"nan nan\nnan nan\n", "4 of 4 heights are NaN or masked$"),
        ("date.txt", b"2026-01-02 12:00\n1 2\n", "begin the lines of a header with #"),
        ("off.xyz", b"0 0 5\n0 1 7\n1 .3 6\n1 1 5\n", "no regular grid .* export the"),
        ("junk.vti", b"<VTKFile", "no whole .vti file"),
        ("junk.vtu", b"junk\xff\n", "meshio cannot read"),
        (
            "short.ply",
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
            b"end_header\n1\n",
            "meshio cannot read it .it is damaged or of another kind.$",
        ),
    ],
    ids=lambda value: str(value)[:12],
)
def test_broken_files_end_in_a_sentence(write, name, content, words):
    """A broken file is refused in one line that names the file and matches `words`."""
    with refused(words) as caught:
        HeightsFromFile(write(name, content), (1.0, 1.0), unit=1.0).build()
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
