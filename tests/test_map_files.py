"""Files of profiles and maps as instruments write them: what is read, and what is
refused.
"""

import itertools
import zipfile

import numpy as np
import pytest
from laboratory import measured_maps

from epcontact import Load, Material, Scene, bem
from epcontact.errors import InvalidScene
from epcontact.surfaces import HeightsFromFile
from epcontact.surfaces.profiles import profile_map
from epcontact.surfaces.readers import read_heights

pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

#: A profile of 200 points, x in mm and heights in µm.
X = np.arange(200) * 0.0125
Z = 3 * np.sin(2 * np.pi * X / 2.5) + np.cos(2 * np.pi * 7 * X / 2.5)


def refused(words):
    """Return a context in which InvalidScene must be raised with a message that matches
    `words`, a regular expression.
    """
    return pytest.raises(InvalidScene, match=words)


def written(path, text, encoding="utf-8"):
    """Write a text to a path and return the path."""
    path.write_bytes(text.encode(encoding))
    return path


def table(columns, separator=" ", mark=".", digits=6):
    """Return columns of numbers, each (n,), as the text of a table.

    The numbers are separated by `separator` and have the decimal mark `mark` and so
    many `digits`.
    """
    lines = []
    for row in np.stack(columns, axis=1):
        cells = [f"{value:.{digits}f}".replace(".", mark) for value in row]
        lines.append(separator.join(cells))
    return "\n".join(lines) + "\n"


# --- profiles -------------------------------------------------------------------------

#: Separator, decimal mark, and what stands between the lines of the file.
FORMATS = {
    "blanks.txt": ("   ", ".", ""),
    "tabs.dat": ("\t", ".", ""),
    "commas.csv": (",", ".", ""),
    "semicolons.csv": (";", ".", ""),
    "decimal commas.csv": (";", ",", ""),
    "decimal commas.txt": ("  ", ",", ""),
    "ended.csv": (",", ".", ","),
}
#: Headers of a profile with x in mm and heights in µm; "" states nothing.
HEADERS = {
    "none": "",
    "brackets": "x [mm]; Höhe [µm]\n",
    "a stylus": '"Scan Length",2.5,"mm"\n\nLateral(mm),Total Profile(µm)\n',
    "words": "# Profile 1\n# mm um\n",
    "the number of points": "X mm,Z um\n200\n",
    "axes": "X-axis: mm\nZ-axis: µm\n",
    "directions": "Horizontal unit: mm\nVertical unit: µm\n",
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize("has_numbers", [False, True])
def test_a_table_of_x_and_height_is_a_line(tmp_path, name, header, has_numbers):
    """Two columns, or three with the number of the point in front, are a line with the
    units of the header or those that are given.
    """
    separator, mark, end = FORMATS[name]
    columns = [np.arange(1.0, 201), X, Z] if has_numbers else [X, Z]
    lines = table(columns, separator, mark).replace("\n", f"{end}\n")
    path = written(tmp_path / name, HEADERS[header] + lines)
    units = {} if HEADERS[header] else {"unit": 1e-6, "periods": (2.5e-3,)}
    recipe = HeightsFromFile(path, treatment="periodic", form=0, **units)
    assert recipe.shape == (200,)
    assert recipe.periods == pytest.approx((2.5e-3,), rel=1e-9)
    surface = recipe.build()
    assert surface.heights == pytest.approx(1e-6 * (Z - Z.mean()), abs=1e-12)
    assert "solved as a surface of ridges" in str(surface.notes)


#: Lines that state lengths of the instrument, and no units of columns.
OTHER_LENGTHS = (
    "Cutoff 0.8 mm; tip radius 2 µm",
    "Cutoff 0,8 mm, tip 2 µm",
    "Filter: 2.5 mm; 8 µm; 25 nm",
    "Stage (0.8 mm); probe (2 µm)",
    "Range x (mm): 5; range z (mm): 2",
    "Range x [mm] 5, range z [mm] 2",
    "Field 1.25 [mm], depth 0.5 [mm]",
    "Lc = .8 mm\tLs = 2.5 µm",
)


UNITS_OF_COLUMNS = (
    "X [µm]\nZ [nm]\n",
    "X [µm]\tZ [nm]\n",
    "X unit: µm\nZ unit: nm\n",
    "X µm, Z nm\n",
)


@pytest.mark.parametrize("line", OTHER_LENGTHS)
@pytest.mark.parametrize("units", UNITS_OF_COLUMNS)
@pytest.mark.parametrize("is_above", [True, False])
def test_lengths_in_a_header_are_no_units_of_columns(tmp_path, line, units, is_above):
    """A line with values scales neither a profile, nor points of a map; the units that
    other lines state count, whichever of both is first.
    """
    header = f"{line}\n{units}" if is_above else f"{units}{line}\n"
    path = written(tmp_path / "a.txt", header + table([X, Z]))
    heights = read_heights(path)
    assert heights.unit == pytest.approx(1e-9)
    assert heights.periods[0] * heights.length_unit == pytest.approx(2.5e-6, rel=1e-3)
    x, y = np.meshgrid(np.arange(12.0), np.arange(9.0))
    z = np.sin(x) + np.cos(y)
    points = table([x.ravel(), y.ravel(), z.ravel()])
    heights = read_heights(written(tmp_path / "b.txt", header + points))
    assert heights.unit == pytest.approx(1e-9)
    assert heights.periods[0] * heights.length_unit == pytest.approx(12e-6, rel=1e-3)
    # Without other lines nothing is stated.
    heights = read_heights(written(tmp_path / "c.txt", f"{line}\n{table([X, Z])}"))
    assert (heights.unit, heights.length_unit) == (None, None)


NO_HEIGHTS = ("1.#QNAN", "-1.#IND", "1.#QNAN0", "-1.#IND00", "1.#SNAN", "#N/A")
NO_HEIGHTS += ("#NV", "#VALUE!", "#DIV/0!", "#NUM!", "#WERT!", "#n/a", "No data")


@pytest.mark.parametrize("cell", NO_HEIGHTS)
def test_a_cell_with_a_number_sign_is_a_missing_height(tmp_path, cell):
    """What C and spreadsheets write for no number is a point without a height wherever
    it stands, and begins no comment; a comment behind a line is left out.
    """
    heights = np.add.outer(np.arange(6.0), 0.1 * np.arange(8.0))
    places = [(3, 0), (0, 4), (5, 7), (0, 0)]
    for separator, place in itertools.product(("\t", ";", ",", "  "), places):
        lines = [[f"{h:.3f}" for h in row] for row in heights]
        lines[place[0]][place[1]] = cell
        text = "\n".join(separator.join(line) for line in lines)
        path = written(tmp_path / "a.txt", f"# heights # 1\n{text} # the last line\n")
        expected = np.round(heights, 3)
        expected[place] = np.nan
        found = read_heights(path).heights
        np.testing.assert_array_equal(found, expected.T, f"{separator}{place}")


@pytest.mark.parametrize("cell", ["1.#INF", "-1.#INF00"])
def test_an_infinite_height_is_no_height_of_one(tmp_path, cell):
    """The infinity of C is refused as that of every other spelling is."""
    path = written(tmp_path / "a.txt", f"1 2 3\n4 {cell} 6\n7 8 9\n")
    with pytest.raises(InvalidScene, match="inf"):
        HeightsFromFile(path, (1e-6, 1e-6), 1e-9, "periodic").build()


def test_the_area_of_a_profile_is_that_of_its_line(tmp_path):
    """A profile from a file has the contact area of the array of its heights."""
    path = written(tmp_path / "a.txt", table([X, Z]))
    recipe = HeightsFromFile(path, (2.5e-3,), 1e-6, "periodic", form=0)
    assert recipe.shape == (200,)
    areas = []
    for heights in (recipe.build().heights, 1e-6 * (Z - Z.mean())):
        surface = type(recipe.build())(heights, (2.5e-3,))
        scene = Scene(surface, Material(1e9, 0.3), Load(1e6))
        areas.append(bem.solve(scene).final.areas["raw"].total)
    assert 0 < areas[0] < 1
    assert areas[0] == pytest.approx(areas[1], abs=1e-12)


@pytest.mark.parametrize(
    "columns",
    [[X, 0 * X + 3, Z], [0 * X, X, Z], [X[::-1], Z[::-1]], [np.round(X, 2), Z]],
    ids=["constant y", "constant x", "backward", "few digits"],
)
def test_points_on_a_straight_line_are_a_profile(tmp_path, columns):
    """Points along x or y, from the end to the start, or with coordinates of few digits
    are the same profile.
    """
    path = written(tmp_path / "a.txt", table(columns))
    recipe = HeightsFromFile(path, (2.5e-3,), 1e-6, "periodic", form=0)
    expected = 1e-6 * (Z - Z.mean())
    assert recipe.build().heights == pytest.approx(expected, abs=1e-12)


def test_uneven_steps_are_interpolated(tmp_path):
    """A profile with uneven steps becomes one with even steps, whose heights are those
    of the wave, and a note gives the steps.
    """
    uneven = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 400)) * 0.00625
    heights = np.sin(2 * np.pi * uneven / 0.625)
    path = written(tmp_path / "a.txt", table([uneven, heights], digits=9))
    recipe = HeightsFromFile(path, (2.466e-3,), 1e-6, "periodic", form=0)
    line = 1e6 * recipe.build().heights
    step = 2.466 / line.size
    even = np.sin(2 * np.pi * (uneven[0] + step * np.arange(line.size)) / 0.625)
    assert line == pytest.approx(even - even.mean(), abs=5e-3)
    note = next(n for n in recipe.build().notes if "uneven" in n)
    assert "from 0.00314 to 0.00937" in note
    assert "changes the rms slope by -0." in note


def test_a_spline_is_the_other_interpolation_of_uneven_steps(tmp_path):
    """The alternative of interpolated heights is a cubic spline, which is nearer to a
    smooth line; even steps have none, and noise at near points makes no spike.
    """
    rng = np.random.default_rng(1)
    uneven = np.cumsum(rng.uniform(0.5, 1.5, 400)) * 0.00625
    heights = np.sin(2 * np.pi * uneven / 0.0625)
    path = written(tmp_path / "a.txt", table([uneven, heights], digits=9))
    options = {"unit": 1e-6, "periods": (2.466e-3,), "form": 0}
    surface = HeightsFromFile(path, treatment="periodic", **options).build()
    (spline,) = surface.alternatives
    assert spline.source == "missing"
    even = uneven[0] + 2.466 / surface.shape[0] * np.arange(surface.shape[0])
    exact = np.sin(2 * np.pi * even / 0.0625)
    other = spline.applied_to(surface).heights
    errors = [np.std(1e6 * h - exact) for h in (surface.heights, other)]
    assert errors[1] < 0.5 * errors[0]
    path = written(tmp_path / "b.txt", table([X, Z]))
    options["periods"] = (2.5e-3,)
    assert (
        not HeightsFromFile(path, treatment="periodic", **options).build().alternatives
    )
    near = np.sort(np.append(uneven, uneven[:-1:20] + 1e-6))
    noisy = np.sin(2 * np.pi * near / 0.0625) + 0.1 * rng.normal(size=near.size)
    assert np.abs(profile_map(near, noisy).otherwise).max() < 2.5


def test_errors_of_uneven_profiles_hold():
    """At least 85 % of the values of lines at uneven steps are within their errors, and
    fewer than three of four without the error of the interpolation.
    """
    rows = measured_maps.of_profiles(("random", "drift"), [907, 908])
    assert (rows["error"] <= rows["estimate"]).mean() >= 0.85
    assert (rows["error"] <= rows["before"]).mean() < 0.75


def test_points_that_a_profile_leaves_out_are_missing(tmp_path):
    """Rows that are left out of even steps, and wide gaps of uneven ones, are missing
    heights, which are refused unless they are filled.
    """
    measured = np.delete(np.arange(200), [50, 51, 90])
    path = written(tmp_path / "a.txt", table([X[measured], Z[measured]]))
    options = {"unit": 1e-6, "periods": (2.5e-3,), "treatment": "periodic"}
    with refused("3 of 200 heights are NaN"):
        HeightsFromFile(path, **options).build()
    surface = HeightsFromFile(path, missing="harmonic", **options).build()
    assert list(np.flatnonzero(surface.filled)) == [50, 51, 90]
    uneven = X + 0.003 * np.sin(np.arange(200) ** 2)
    measured = np.delete(np.arange(200), range(100, 120))
    path = written(tmp_path / "b.txt", table([uneven[measured], Z[measured]]))
    surface = HeightsFromFile(path, missing="harmonic", **options).build()
    assert surface.filled is not None
    assert 18 <= np.count_nonzero(surface.filled) <= 22


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ([Z, X], "its two columns are no profile"),
        ([1e307 * (2 * X - 1), Z], "its two columns are no profile"),
        ([X, Z, Z + 1], "leave one column of heights"),
        ([X, Z, X, Z + 1], "its 4 columns are neither x, y and height"),
    ],
)
def test_columns_that_are_no_profile_are_refused(tmp_path, columns, message):
    """Two columns whose first is no x, and two columns of heights, are refused."""
    path = written(tmp_path / "a.txt", table(columns))
    with refused(message):
        HeightsFromFile(path, (2.5e-3,), 1e-6)


def test_a_profile_of_unknown_x_needs_a_period(tmp_path):
    """If the header does not state the unit of x, the length is asked for, and a period
    of other digits than x is refused.
    """
    bare = written(tmp_path / "b.txt", table([X, Z], ";"))
    path = written(tmp_path / "a.txt", "x; height [µm]\n" + table([X, Z], ";"))
    for file, unit in ((path, None), (bare, 1e-6)):
        with refused("does not state the unit of its x; give the length of the map"):
            HeightsFromFile(file, unit=unit)
    assert HeightsFromFile(path, (2.5e-3,)).shape == (200,)
    with refused(
        r"states lengths of 2.5 .*\(the x of its points\), but period = \[0.0"
    ):
        HeightsFromFile(path, (2e-3,))


# --- headers of maps ------------------------------------------------------------------

#: A map of 20 lines with 30 heights.
MAP = np.random.default_rng(2).standard_normal((20, 30))
#: Headers that state 6 µm along x, 4 µm along y and heights in nm.
STATED = {
    "gwyddion": "# Channel: Height\n# Width: 6.000 µm\n# Height: 4.000 µm\n"
    "# Value units: nm\n",
    "gwyddion in German": "# Kanal: Höhe\n# Breite: 6,000 µm\n# Höhe: 4,000 µm\n"
    "# Einheiten: nm\n",
    "translated": "# Breite: 6,000 µm\n# Höhe: 4,000 µm\n# Werteinheiten: nm\n",
    "nanoscope": '"\\*File list"\n"\\Scan Size: 6 x 4 um"\n"\\Z units: nm"\n',
    "spip": "# File Format = ASCII\n# x-pixels = 30\n# y-pixels = 20\n"
    "# x-length = 6000\n# y-length = 4000\n# z-unit = [nm]\n",
    "wsxm": "WSxM file\nX Amplitude: 6 µm\nY Amplitude: 4 µm\nZ Amplitude: 7 nm\n",
    "keyence": '"Model","VK"\n"Horizontal","30"\n"XY Calibration","200","nm"\n'
    '"Unit","nm"\n"Height"\n',
    "both": "Some text\nScan Size: 6 x 4 µm\nunit of z = nm\n",
    "points": "Width: 30\nHeight: 20\nXY unit: um\nPixel size: 0.2\nz unit: nm\n",
    "steps": "dx(um),0.2\ndy(um),0.2\nheights in nanometres\n",
    "nova": "Unit X = um\nScale X = 0.2\nScale Y = 0.2\nUnit Data = nm\n",
}


@pytest.mark.parametrize("name", STATED)
def test_units_and_sizes_of_a_header_are_read(tmp_path, name):
    """The unit and the lengths of a header are those of the map, and a note gives the
    unit.
    """
    lines = table(MAP.T, ",")
    if name == "keyence":
        lines = "\n".join(f'"{row}"' for row in lines.replace(",", '","').split())
    path = written(tmp_path / "a.csv", STATED[name] + lines)
    recipe = HeightsFromFile(path, treatment="periodic", form=0)
    assert recipe.shape == (30, 20)
    assert recipe.periods == pytest.approx((6e-6, 4e-6), rel=1e-12)
    surface = recipe.build()
    expected = 1e-9 * (MAP - MAP.mean())
    heights = surface.heights.T
    assert heights == pytest.approx(expected, abs=1e-15)
    assert "the unit of the heights is 1e-09 m; the file states: " in str(surface.notes)


@pytest.mark.parametrize("name", STATED)
@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("unit", 1e-6, "unit"),
        ("periods", (6e-3, 4e-3), "size"),
        ("periods", (4e-6, 6e-6), "size"),
        ("pixel_size", 1e-6, "size"),
    ],
)
def test_contradictions_to_a_header_are_refused(tmp_path, name, key, value, word):
    """A key that contradicts the header is refused with both values, unless `accept`
    has its word.  A key that agrees is accepted.
    """
    path = written(tmp_path / "a.csv", STATED[name] + table(MAP.T, ","))
    shown = "period" if key == "periods" else key
    with refused(f"a.csv states .*, but {shown} = .* accept = .*{word}"):
        HeightsFromFile(path, **{key: value})
    recipe = HeightsFromFile(path, **{key: value}, accept=(word,))
    assert recipe.unit == (value if key == "unit" else None)
    agreeing = HeightsFromFile(path, (6e-6, 4e-6), unit=1e-9)
    assert agreeing.periods == (6e-6, 4e-6)


@pytest.mark.parametrize("line", ["# Value units: V", "z-unit = [deg]", "Unit Data=nA"])
def test_values_that_are_no_heights_are_refused(tmp_path, line):
    """A header that states a voltage, an angle or a current is refused."""
    path = written(tmp_path / "a.txt", f"{line}\n{table(MAP.T)}")
    with refused('its header states ".*", which is no unit of heights; export the'):
        HeightsFromFile(path, unit=1e-9, pixel_size=1e-6)


@pytest.mark.parametrize("line", ["NODATA_value  -9999", "# No data value: -9999.0"])
def test_the_mark_of_missing_points_is_read(tmp_path, line):
    """Heights that the header names as missing are, and a note says so."""
    marked = MAP.T.copy()
    marked[3, 5:8] = -9999
    path = written(tmp_path / "a.txt", f"ncols 30\n{line}\n{table(marked)}")
    options = {"unit": 1e-9, "pixel_size": 1e-6}
    with refused("3 of 600 heights are NaN"):
        HeightsFromFile(path, **options).build()
    recipe = HeightsFromFile(path, missing="nearest", **options)
    surface = recipe.build()
    assert np.count_nonzero(surface.filled) == 4 * 3
    assert "-9999 marks points without a height" in str(surface.notes)


def test_a_last_line_of_words_is_named(tmp_path):
    """Words below a table are refused with their line, whatever separates numbers."""
    path = written(tmp_path / "a.csv", table([X, Z], ";") + "END OF FILE\n")
    with refused("line 201 holds 'END OF FILE'"):
        HeightsFromFile(path, (2.5e-3,), 1e-6)


def test_an_archive_of_arrays_is_to_be_unpacked(tmp_path):
    """A .npz file is refused with the names of its arrays."""
    np.savez(tmp_path / "a.npz", heights=MAP)
    with refused(r"give the path of the map inside \(heights.npy\)"):
        HeightsFromFile(tmp_path / "a.npz", (6e-6, 4e-6), 1e-9)


def test_one_size_is_that_of_a_square_map(tmp_path):
    """A single scan size counts for both directions of a square map, and for no other
    map.
    """
    header = "Scan Size (µm): 5\nValue units: nm\n"
    square = written(tmp_path / "a.txt", header + table(MAP[:, :20]))
    assert HeightsFromFile(square).periods == pytest.approx((5e-6, 5e-6))
    oblong = written(tmp_path / "b.txt", header + table(MAP.T))
    with refused("does not say how large the map is"):
        HeightsFromFile(oblong)


def test_a_header_that_contradicts_itself_is_refused(tmp_path):
    """A pixel size and a width that differ are refused with both lines."""
    header = "# Width: 6 µm\n# Height: 4 µm\n# Pixel size: 2 nm\n"
    path = written(tmp_path / "a.txt", header + table(MAP.T))
    with refused('"Width: 6 µm" and, for 30 points, "Pixel size: 2 nm"'):
        HeightsFromFile(path, unit=1e-9)


def test_a_point_list_has_the_units_of_its_columns(tmp_path):
    """A list of x, y and height has the units that its header gives the columns."""
    points = [(x, y, MAP[y, x]) for x, y in itertools.product(range(30), range(20))]
    lines = table(np.transpose(points), ",")
    path = written(tmp_path / "a.csv", "X [µm], Y [µm], Z [nm]\n" + lines)
    recipe = HeightsFromFile(path, treatment="periodic", form=0)
    assert recipe.periods == pytest.approx((30e-6, 20e-6))
    surface = recipe.build()
    expected = 1e-9 * (MAP - MAP.mean())
    heights = surface.heights.T
    assert heights == pytest.approx(expected, abs=1e-15)


# --- .x3p -----------------------------------------------------------------------------

#: A document main.xml without its records; {} are the root's attributes, and the three.
DOCUMENT = """<?xml version="1.0" encoding="UTF-8"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">
<Record1><Revision>{revision}</Revision><FeatureType>{feature}</FeatureType><Axes>
<CX><AxisType>{x_type}</AxisType><DataType>D</DataType>
<Increment>{dx}</Increment><Offset>0.0</Offset></CX>
<CY><AxisType>I</AxisType><Increment>2e-6</Increment></CY>
<CZ><AxisType>A</AxisType><DataType>{z_type}</DataType>{scale}</CZ>
</Axes></Record1><Record3>
<MatrixDimension><SizeX>30</SizeX><SizeY>{ny}</SizeY><SizeZ>{nz}</SizeZ>
</MatrixDimension>{data}</Record3></p:ISO5436_2>
"""
LINK = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink>{}</DataLink>"
VALID = "<ValidPointsLink>bindata/valid.bin</ValidPointsLink>"
PLAIN = {
    "revision": "ISO5436 - 2000",
    "feature": "SUR",
    "x_type": "I",
    "dx": "1e-6",
    "z_type": "D",
    "scale": "",
    "ny": 20,
    "nz": 1,
    "data": LINK.format(""),
}


def x3p(path, content, folder="", valid=b"", **changes):
    """Write an .x3p file and return its path.

    `content` are the bytes of its heights, `folder` is in front of the names of all
    members, `valid` are the bits of the valid points, and `changes` are those to PLAIN.
    """
    with zipfile.ZipFile(path, "w") as archive:
        document = DOCUMENT.format(**PLAIN | changes)
        archive.writestr(f"{folder}main.xml", document)
        archive.writestr(f"{folder}bindata/data.bin", content)
        if valid:
            archive.writestr(f"{folder}bindata/valid.bin", valid)
    return path


#: Heights of the map in m, a line of the file for each y, as the standard stores them.
HEIGHTS = 1e-7 * MAP
STEPS = np.rint(HEIGHTS / 1e-12).astype("<i4")
LISTED = "".join(f"<Datum>{value!r}</Datum>" for value in HEIGHTS.ravel().tolist())
X3P = {
    "doubles": (HEIGHTS.tobytes(), {}),
    "revision": (HEIGHTS.tobytes(), {"revision": "ISO5436 - 2000 (vendor)"}),
    "folder": (HEIGHTS.tobytes(), {"folder": "sample 1/"}),
    "steps": (
        STEPS.tobytes(),
        {
            "z_type": "L",
            "scale": "<Increment>1e-12</Increment><Offset>3e-6</Offset>",
        },
    ),
    "listed": (b"", {"data": f"<DataList>{LISTED}</DataList>"}),
}


@pytest.mark.parametrize("name", X3P)
def test_x3p_files_are_read_by_their_standard(tmp_path, name):
    """Heights in an archive's member or in its document, of any type and revision, have
    the lengths of the axes and are in m.
    """
    content, changes = X3P[name]
    path = x3p(tmp_path / "a.x3p", content, **changes)
    recipe = HeightsFromFile(path, treatment="periodic", form=0)
    assert recipe.periods == pytest.approx((30e-6, 40e-6))
    heights = recipe.build().heights.T
    assert heights == pytest.approx(HEIGHTS - HEIGHTS.mean(), abs=2e-12)
    with refused(r"states 1 m .*\.x3p files are in m.*, but unit = 1e-06 is given"):
        HeightsFromFile(path, unit=1e-6)


def test_points_of_an_x3p_without_a_height_are_missing(tmp_path):
    """Points whose bit is not set, and empty entries of a list, are missing."""
    is_valid = np.arange(600) % 7 != 3
    bits = np.packbits(is_valid, bitorder="little").tobytes()
    linked = x3p(
        tmp_path / "a.x3p", HEIGHTS.tobytes(), valid=bits, data=LINK.format(VALID)
    )
    entries = []
    for value, valid in zip(HEIGHTS.ravel().tolist(), is_valid, strict=True):
        entries.append(f"<Datum>{value!r}</Datum>" if valid else "<Datum/>")
    listed = f"<DataList>{''.join(entries)}</DataList>"
    for path in (linked, x3p(tmp_path / "b.x3p", b"", data=listed)):
        surface = HeightsFromFile(path, treatment="periodic", missing="nearest").build()
        assert surface.filled is not None
        assert np.array_equal(surface.filled.T.ravel(), ~is_valid)


def test_an_x3p_of_one_line_is_a_profile(tmp_path):
    """A file with one line is a line; x may be stored beside the heights."""
    heights = HEIGHTS[0]
    path = x3p(tmp_path / "a.x3p", heights.tobytes(), ny=1, feature="PRF")
    recipe = HeightsFromFile(path, treatment="periodic", form=0)
    assert recipe.periods == pytest.approx((30e-6,))
    assert recipe.build().heights == pytest.approx(heights - heights.mean())
    pairs = np.stack([np.arange(30) * 1e-6, heights], axis=1).tobytes()
    path = x3p(tmp_path / "b.x3p", pairs, ny=1, feature="PRF", x_type="A", dx="1")
    recipe = HeightsFromFile(path, treatment="periodic", form=0)
    assert recipe.periods == pytest.approx((30e-6,))
    assert recipe.build().heights == pytest.approx(heights - heights.mean())


@pytest.mark.parametrize(
    ("content", "changes", "message"),
    [
        (b"", {}, "holds 0 of the 600 points that its main.xml states"),
        (
            b"",
            {"data": LINK.format("").replace("data.", "x.")},
            "does not hold .*x.bin",
        ),
        (b"", {"nz": 2}, "holds 2 layers"),
        (b"", {"z_type": "Q"}, "axis CZ have the type 'Q', but I, L, F, D"),
        (b"", {"ny": "many"}, r"no complete .x3p file \(invalid literal"),
    ],
)
def test_x3p_files_that_break_the_standard_are_refused(
    tmp_path, content, changes, message
):
    """The message says which rule the file breaks, and names no other reader."""
    with refused(f"a.x3p: .*{message}"):
        HeightsFromFile(x3p(tmp_path / "a.x3p", content, **changes))


def test_an_archive_without_a_document_is_no_x3p(tmp_path):
    """An archive without main.xml, and a file that is no archive, are refused."""
    with zipfile.ZipFile(tmp_path / "a.x3p", "w") as archive:
        archive.writestr("other.xml", "<a/>")
    with refused(r"is no .x3p file, because its archive holds no main\.xml"):
        HeightsFromFile(tmp_path / "a.x3p")
    path = written(tmp_path / "b.x3p", "no archive")
    with refused(r"no complete .x3p file \(File is not a zip file\); export it again"):
        HeightsFromFile(path)
