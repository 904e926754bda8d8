"""Field files and their views.

What was written is read back, by epcontact and by pyvista, and drawn.  Views are drawn
from files alone; what cannot be drawn is refused in one sentence.
"""

import ctypes.util
import functools
import importlib.util
import itertools
import math
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import pyvista as pv
from command_line import python
from PIL import Image, ImageSequence

from epcontact.errors import OutputError
from epcontact.output import drawing, view
from epcontact.output.charts.maps import map_of_file, save_map
from epcontact.output.vtk import read_fields, write_fields, write_image
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    Areas,
    ContactResult,
    LoadStep,
    Provenance,
)
from epcontact.scene import Surface

# Heights of independent points are steep.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

HARDNESS = 5e8  # Pa
PERIODS = (6e-6, 2e-4)  # m, along x and y


def states_of(pressure, hardness):
    """Return the state of each point: APART without pressure, PLASTIC from the hardness
    (Pa) on, else ELASTIC.

    `pressure` (Pa) and the returned array have one shape.
    """
    state = np.full(pressure.shape, APART)
    state[pressure > 0] = ELASTIC
    state[pressure >= hardness] = PLASTIC
    return state


def asymmetric(shape):
    """Return a result whose fields no transposition, reflection or shift maps on
    themselves.

    `shape` is the number of points in each direction.
    """
    heights = 1e-6 * np.random.default_rng(20260721).standard_normal(shape)
    pressure = np.clip(heights * 1e15, 0, HARDNESS)
    fields = {
        "heights": heights,
        "pressure": pressure,
        "gap": -0.3 * heights,
        "displacement": 2 * heights + 1e-7,
        "state": states_of(pressure, HARDNESS).astype(np.int8),
    }
    step = LoadStep(
        mean_pressure=1.25e8,
        areas={"raw": Areas(0.3, 0.1, 0.2), "corrected": Areas(0.28, 0.11, 0.17)},
        residuals={"gap": 1.5e-9},
        iterations={"newton": 4},
        quantities={"mean_gap": 2e-7},
    )
    provenance = Provenance("digest", 7, {"law": "capped", "levels": [1, 2]})
    return ContactResult("bem", (step,), provenance, fields=fields)


def write_and_read(path, result, attributes=None, **options):
    """Write the fields of a result to `path` with write_fields, and return what
    read_fields reads.

    `attributes` are further values in the file by their names, and `options` those of
    write_fields.
    """
    heights = result.fields.get("heights", np.eye(5, 3))
    surface = Surface(heights, PERIODS[: heights.ndim], seed=7)
    write_fields(path, result, surface, attributes, **options)
    return read_fields(path)


def test_every_value_is_at_its_place_in_single_and_double_precision(tmp_path):
    """Each value lies at its point for pyvista and for epcontact.

    Single precision rounds to 32 bits, and double precision keeps each bit.
    """
    result = asymmetric((6, 100))  # more columns than are copied at a time
    path = tmp_path / "out" / "bem.vti"
    single = write_and_read(path, result, {"hardness": HARDNESS})
    double = write_and_read(tmp_path / "double.vti", result, precision="double")
    image = pv.read(path)
    assert image.dimensions == (7, 101, 1)
    assert image.origin == (0, 0, 0)
    assert image.spacing[:2] == (1e-6, 2e-6)
    assert image.active_scalars_name == "pressure"
    assert set(image.point_data.keys()) == set(result.fields)
    i, j = np.rint(image.points[:, :2] / image.spacing[:2]).astype(int).T
    for name, field in result.fields.items():
        at_points = field[i % 6, j % 100]  # of the next period at the end
        assert np.array_equal(image.point_data[name], np.float32(at_points))
        kind = np.uint8 if name == "state" else np.float32
        assert single.fields[name].dtype == kind
        assert np.array_equal(single.fields[name], field.astype(kind))
        assert np.array_equal(double.fields[name], field)
    assert single.periods == pytest.approx(PERIODS, rel=1e-15)


def test_a_file_states_units_and_the_origin_of_its_result(tmp_path):
    """A field file holds options, seed, residuals and library versions of its result,
    and the unit of each field where ParaView shows it.
    """
    result = asymmetric((6, 4))
    path = tmp_path / "bem.vti"
    file = write_and_read(path, result, {"hardness": HARDNESS})
    expected_attributes = {
        "version.numpy": np.__version__,
        "option.levels": "[1, 2]",
        "seed": 7,
        "residual.gap": 1.5e-9,
        "iterations.newton": 4,
        "hardness": HARDNESS,
    }
    assert expected_attributes.items() <= file.attributes.items()
    image = pv.read(path)
    assert image.field_data["hardness"][0] == HARDNESS
    assert image.field_data["unit.pressure"][0] == "Pa"
    # ParaView shows the labels in the head of the file.
    head = path.read_bytes().partition(b"<AppendedData")[0].decode()
    label = r'Name="(\w+)"[^>]*><Info[^>]*UNITS_LABEL[^>]*>([^<]+)<'
    lengths = ("heights", "gap", "displacement")
    expected_units = dict.fromkeys(lengths, "m") | {"pressure": "Pa", "state": "1"}
    assert dict(re.findall(label, head)) == expected_units


def test_spacing_and_numbers_keep_every_bit(tmp_path):
    """Spacing and attributes are read back to the last bit; integers beyond 64 bits
    become text.
    """
    spacing = (2.513274e-4 / 1024, math.pi * 1e-7)
    attributes = {
        "third": 1 / 3,
        "inf": math.inf,
        "big": 2**100,
        "seed": 2**62 + 1,
        "empty": "",
        '<a> & "b"': "<c> & 'd'",
    }
    path = tmp_path / "x.vti"
    write_image(path, {"a": np.ones((3, 2))}, spacing, attributes)
    file = read_fields(path)
    assert file.spacing == spacing
    assert file.attributes == {**attributes, "big": str(2**100)}


@pytest.mark.parametrize("shape", [(32, 16), (7,)])
def test_the_integral_of_the_pressure_is_the_load(shape, tmp_path):
    """VTK's integral over a file is the mean pressure times the area of the period, or
    the length of a line's.

    Lists of numbers are arrays in the file.  `shape` is the grid.
    """
    result = asymmetric(shape)
    about = {"load_path": {"value": [1e5, 2e5], "unit": "Pa", "meaning": "loads"}}
    provenance = replace(result.provenance, about=about)
    result = replace(result, provenance=provenance)
    path = tmp_path / "x.vti"
    file = write_and_read(path, result, precision="double")
    assert file.attributes["load_path"] == (1e5, 2e5)
    image = pv.read(path)
    assert image.field_data["load_path"].tolist() == [1e5, 2e5]
    integral = image.integrate_data().point_data["pressure"][0]
    size = math.prod(PERIODS[: len(shape)])
    assert integral == pytest.approx(result.fields["pressure"].mean() * size, rel=1e-9)


@pytest.mark.parametrize("shape", [(6, 4), (7,)])
def test_a_displacement_that_follows_from_the_rest_is_left_out(shape, tmp_path):
    """The displacement under a flat counterface is not written, as it is gap + heights
    - flat_height.

    `shape` is the grid of a surface and of a line.
    """
    result = asymmetric(shape)
    displacement = 0.7 * result.fields["heights"] - 3e-7  # under a flat
    result.fields["displacement"] = displacement
    file = write_and_read(tmp_path / "x.vti", result)
    assert file.fields.keys() == result.fields.keys() - {"displacement"}
    assert file.shape == shape
    assert file.units["flat_height"] == "m"
    moved = file.fields["gap"] + file.fields["heights"] - file.attributes["flat_height"]
    assert moved == pytest.approx(displacement, abs=1e-6 * np.ptp(displacement))


@pytest.mark.parametrize(
    ("error", "sentence", "path", "fields"),
    [
        (OutputError, "bem gives no fields", "x.vti", {}),
        (OutputError, r"must be named \.vti", "x.vtk", {"gap": np.ones((5, 3))}),
        (ValueError, "lie on no grid", "x.vti", {"gap": np.ones((4, 5))}),
        (OutputError, "file", "file/x.vti", {"gap": np.ones((5, 3))}),
    ],
)
def test_what_cannot_be_written(tmp_path, error, sentence, path, fields):
    """`write_fields` raises `error` with `sentence` for a path or fields that it cannot
    write, and leaves no file.
    """
    (tmp_path / "file").write_text("")
    result = replace(asymmetric((5, 3)), fields=fields)
    with pytest.raises(error, match=sentence):
        write_and_read(tmp_path / path, result)
    assert os.listdir(tmp_path) == ["file"]


def test_what_cannot_be_read(tmp_path, capfd):
    """`read_fields` raises OutputError for a missing, foreign, damaged or truncated
    file, of which every fortieth is tried, and VTK prints nothing.
    """
    path = tmp_path / "x.vti"
    with pytest.raises(OutputError, match="no such file"):
        read_fields(path)
    write_and_read(path, asymmetric((6, 100)), {"hardness": HARDNESS})
    content = path.read_bytes()
    damaged = {
        b"not a picture of anything": "no VTK image file",
        content.replace(b"</Piece>", b"</Peace>"): "damaged",
    }
    for fortieth in range(40):
        damaged[content[: fortieth * len(content) // 40]] = "cannot read"
    for beginning, sentence in damaged.items():
        path.write_bytes(beginning)
        with pytest.raises(OutputError, match=sentence):
            read_fields(path)
    assert capfd.readouterr() == ("", "")


# --- views ----------------------------------------------------------------------------

WHITE = (255, 255, 255)
YELLOW = (240, 196, 25)
BLACK = (0, 0, 0)
BLUE = (0, 114, 178)
#: The end of the colour map of pressures.
DARKEST = (68, 1, 84)
#: Makes VTK draw without a display.
OFF_SCREEN = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkOSOpenGLRenderWindow"}


@pytest.fixture(scope="session")
def can_draw(tmp_path_factory):
    """Skip the test if this machine cannot draw in three dimensions."""
    folder = tmp_path_factory.mktemp("can-draw")
    try:
        view.screenshot(surface_file(folder / "x.vti"), folder / "x.png", size=(80, 40))
    except OutputError as error:
        pytest.skip(str(error))


def surface_file(path, radius=0.3):
    """Write a surface with one round contact, plastic within elastic, left of the
    middle.

    `radius` is that of the contact as a fraction of the period; the grid has 80 x 60
    points, 1 µm apart. Returns `path`.
    """
    hardness = 1.5e10
    x, y = np.meshgrid(*(np.arange(n) / n for n in (80, 60)), indexing="ij")
    top = radius**2 - (x - 0.3) ** 2 - (y - 0.5) ** 2
    pressure = np.clip(3e10 * top / radius**2, 0, hardness)
    fields = {
        "pressure": pressure,
        "gap": np.where(top > 0, 0.0, -1e-5 * top),
        "state": states_of(pressure, hardness),
    }
    write_image(path, fields, (1e-6, 1e-6), {"method": path.stem, "hardness": hardness})
    return path


def block_file(path, load=1.0):
    """Write a block of 10 µm whose deformation, stress and strain are proportional to
    `load`.

    Returns `path`.
    """
    axis = np.linspace(0.0, 1e-5, 9)
    mesh = pv.RectilinearGrid(axis, axis, axis[::2] - 1e-5).cast_to_unstructured_grid()
    decay = np.exp(mesh.points[:, 2] / 3e-6)
    displacement = np.zeros((mesh.n_points, 3))
    displacement[:, 2] = -1e-8 * load * decay
    mesh.point_data["displacement"] = displacement
    mesh.point_data["von_mises"] = 1e9 * load * decay
    strain = np.linspace(0, 0.01 * load, mesh.n_cells)
    mesh.cell_data["equivalent_plastic_strain"] = strain
    mesh.save(path)
    return path


def pixels_of(picture):
    """Return the colours (height, width, 3) of a picture file, from 0 to 255."""
    with Image.open(picture) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def frames_of(film):
    """Return the colours (height, width, 3) of each frame of a film, and the tuple of
    its number of frames, of loops (0: endless) and of milliseconds for each frame.
    """
    with Image.open(film) as image:
        frames = [
            np.asarray(frame.convert("RGB")).astype(int)
            for frame in ImageSequence.Iterator(image)
        ]
        return frames, (image.n_frames, image.info["loop"], image.info["duration"])


def has_colour(pixels, colour):
    """Return an array (height, width) that is true where `pixels` (height, width, 3)
    differ by less than 12 of 255 from a colour.
    """
    return np.abs(pixels - np.array(colour)).max(axis=2) < 12


@pytest.mark.usefixtures("can_draw")
def test_a_surface_shows_elastic_yellow_and_plastic_black(tmp_path, capfd):
    """The left half of a view shows elastic points yellow and plastic points black at
    their place, and the right half shows the pressure.

    The only file written is the picture.
    """
    picture = tmp_path / "out" / "x.png"
    view.screenshot(surface_file(tmp_path / "bem.vti"), picture, size=(800, 400))
    pixels = pixels_of(picture)
    assert pixels.shape == (400, 800, 3)
    state = pixels[40:300, :400]
    pressure = pixels[40:300, 400:]
    plastic = has_colour(state, BLACK)
    assert has_colour(state, YELLOW).sum() > 1000
    assert plastic.sum() > 1000
    assert has_colour(pressure, YELLOW).sum() < 100  # its yellow is another one
    _, columns = np.nonzero(plastic)
    assert columns.mean() < 190  # left of the middle of the surface
    assert capfd.readouterr() == ("", "")
    assert os.listdir(tmp_path / "out") == ["x.png"]


def count_red(pixels):
    """Return the number of red pixels in an array (height, width, 3) of colours."""
    red, green, blue = np.moveaxis(pixels, 2, 0)
    return np.sum((red > blue + 60) & (green < 120))


def test_two_results_and_their_difference(tmp_path):
    """`compare` draws two results in one scale, and the difference of their pressures
    in red.
    """
    first = surface_file(tmp_path / "bem.vti", 0.3)
    second = surface_file(tmp_path / "fem.vti", 0.2)
    picture = tmp_path / "x.png"
    view.compare(first, second, picture)
    panels = np.array_split(pixels_of(picture), 3, axis=1)
    dark_first, dark_second, _ = (has_colour(p, DARKEST).sum() for p in panels)
    assert dark_first > 1.5 * dark_second > 0
    red_first, red_second, red_difference = (count_red(panel) for panel in panels)
    assert red_difference > 200 > max(red_first, red_second)


def write_collection(path, files):
    """Write a collection (.pvd) of files to `path`. The last file has the first
    time.
    """
    entries = [
        f'<DataSet timestep="{-number}" file="{file.name}"/>'
        for number, file in enumerate(files)
    ]
    path.write_text(f"<VTKFile><Collection>{''.join(entries)}</Collection></VTKFile>")


@pytest.mark.usefixtures("can_draw")
def test_a_film_has_a_frame_for_each_load(tmp_path):
    """A film has one frame of 330 ms for each load of a collection, in the order of
    times, or for each file given.

    Without imageio-ffmpeg an .mp4 raises OutputError.
    """
    blocks = [block_file(tmp_path / f"{load}.vtu", load) for load in (2.0, 3.0, 1.0)]
    collection = tmp_path / "fem.pvd"
    write_collection(collection, blocks)
    assert view.load_steps(collection) == blocks[::-1]
    surfaces = [surface_file(tmp_path / f"{r}.vti", r) for r in (0.1, 0.2)]
    film = tmp_path / "x.gif"
    for sources, count in (([collection], 3), (surfaces, 2)):
        view.animate(sources, film, size=(400, 200))
        frames, about = frames_of(film)
        assert about == (count, 0, 330)
        for frame, following in itertools.pairwise(frames):
            assert np.any(frame != following)
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        with pytest.raises(OutputError, match=r"imageio-ffmpeg.*\.gif"):
            view.animate(surfaces, tmp_path / "x.mp4", size=(100, 50))


@pytest.mark.usefixtures("can_draw")
def test_films_and_blocks_show_each_load_in_one_scale(tmp_path):
    """All frames of a film have the scale of the largest load, here the second."""
    blocks = [block_file(tmp_path / f"{load}.vtu", load) for load in (2.0, 3.0, 1.0)]
    with mock.patch.object(drawing, "draw_block", wraps=drawing.draw_block) as draw:
        view.animate(blocks, tmp_path / "x.gif", size=(200, 100))
    _, largest = drawing.block_scale(drawing.read_block(blocks[1]))
    assert [call.args[3] for call in draw.call_args_list] == [largest] * 3


@pytest.mark.usefixtures("can_draw")
def test_a_factor_stretches_the_displacements_of_a_block(tmp_path):
    """A block that is drawn with a large factor looks different from its true shape."""
    block = block_file(tmp_path / "x.vtu")
    pictures = []
    for factor in (1.0, 300.0):
        picture = tmp_path / f"{factor}.png"
        view.screenshot(block, picture, factor=factor, size=(600, 300))
        pictures.append(pixels_of(picture)[30:])
    true_shape, stretched = pictures
    assert has_colour(true_shape, WHITE).mean() > 0.2
    assert np.mean(np.any(true_shape != stretched, axis=2)) > 0.05


def titles_of(mesh):
    """Return the titles of the colour bars of a drawn block, and its other texts, as
    two lists.

    `mesh` is what drawing.read_block returns.
    """
    plotter = mock.MagicMock()
    _, limits = drawing.block_scale(mesh)
    drawing.draw_block(plotter, mesh, 1.0, limits)
    bars = [
        call.kwargs["scalar_bar_args"]["title"].strip()
        for call in plotter.add_mesh.call_args_list
        if "scalar_bar_args" in call.kwargs
    ]
    return bars, [call.args[0] for call in plotter.add_text.call_args_list]


def test_a_mesh_of_a_surface_shows_its_pressure_and_its_gap():
    """A mesh that is a surface, as other codes write it, shows contact pressure and
    gap.
    """
    mesh = pv.Plane(i_size=2e-3, j_size=1e-3).cast_to_unstructured_grid()
    mesh.point_data["contact_pressure"] = np.full(mesh.n_points, 2e9)
    mesh.point_data["gap"] = np.linspace(0, 3e-6, mesh.n_points)
    bars, texts = titles_of(mesh)
    assert bars == ["contact pressure (GPa)", "gap (µm)"]
    assert texts == ["2 × 1 × 0 mm, undeformed"]


def test_a_block_without_strain_says_so(tmp_path):
    """A block without plastic strain in its file shows the von Mises stress, and a
    note.
    """
    mesh = drawing.read_block(block_file(tmp_path / "x.vtu"))
    mesh.cell_data.remove("equivalent_plastic_strain")
    bars, texts = titles_of(mesh)
    assert bars == ["von Mises stress (GPa)"]
    assert texts == [
        "no equivalent plastic strain in the file",
        "10 × 10 × 10 µm, displacements × 1",
    ]


def test_a_surface_without_hardness_ends_its_scale_at_the_largest_pressure(tmp_path):
    """The scale of pressures of an elastic surface ends at its largest pressure in
    Pa.
    """
    path = tmp_path / "x.vti"
    pressure = np.array([[0.0, 3e6], [2e6, 0.0]])
    write_image(path, {"pressure": pressure, "gap": pressure}, (1e-6, 1e-6), {})
    _, limits = drawing.surface_scale(read_fields(path))
    assert limits == (3e6,)


def test_the_map_of_a_line_is_its_profile(tmp_path):
    """The contact map of a line is a chart of its profile, and `save_map` writes only
    that.
    """
    pressure = np.array([0.0, 3e6, 0.0])
    fields = {"pressure": pressure, "gap": 3e6 - pressure, "state": np.sign(pressure)}
    write_image(tmp_path / "x.vti", fields, (1e-6,), {})
    chart = map_of_file(tmp_path / "x.vti")
    assert chart.header == ("x_m", "state", "pressure_Pa", "gap_m")
    save_map(tmp_path / "x.vti", tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes() == chart.png()
    assert sorted(os.listdir(tmp_path)) == ["map.png", "x.vti"]


def test_a_line_is_drawn_without_vtk(tmp_path, monkeypatch):
    """Lines are drawn by matplotlib alone.

    A film of two loads has one scale of pressures.
    """
    monkeypatch.delattr(drawing, "draw")
    pressure = np.maximum(np.sin(np.arange(50) / 5), 0)
    steps = []
    for load in (1, 2):
        fields = {
            "pressure": load * pressure,
            "gap": 1 - pressure,
            "state": np.ceil(2 * pressure),
        }
        step = tmp_path / f"{load}.vti"
        write_image(step, fields, (1e-6,), {})
        steps.append(step)
    view.screenshot(steps[0], tmp_path / "x.png")
    assert has_colour(pixels_of(tmp_path / "x.png"), BLACK).sum() > 50
    view.animate(steps, tmp_path / "x.gif")
    frames, _ = frames_of(tmp_path / "x.gif")
    first_load, second_load = (has_colour(frame, BLUE).sum() for frame in frames)
    assert 1.8 < second_load / first_load < 2.2  # in one scale


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="these windows are Linux's"
)
@pytest.mark.parametrize(
    ("call", "environment", "sentence"),
    [
        (
            "show('x.vti')",
            {"DISPLAY": ":7531"},
            "no window can be opened without a display",
        ),
        ("screenshot('x.vti', 'x.png')", OFF_SCREEN, "no display, EGL or OSM"),
    ],
)
def test_where_nothing_can_be_drawn(tmp_path, call, environment, sentence):
    """Without a display or OSMesa a view raises OutputError with one sentence, and no
    file is written.

    VTK would draw where nobody sees it, warn on the terminal, or crash without its
    libraries.

    `call` is the view as Python code, `environment` are variables that VTK reads, and
    `sentence` is a part of the message.
    """
    if environment == OFF_SCREEN and ctypes.util.find_library("OSMesa"):
        pytest.skip("OSMesa is installed")
    surface_file(tmp_path / "x.vti")
    code = (
        "from epcontact.output.view import *\n"
        f"try: {call}\n"
        "except OutputError as error: print(error)"
    )
    without_display = dict(os.environ)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        without_display.pop(name, None)
    done = python("-c", code, cwd=tmp_path, env=without_display | environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("\n") == 1
    assert sentence in done.stdout
    assert os.listdir(tmp_path) == ["x.vti"]


@pytest.fixture
def some_files(tmp_path, monkeypatch):
    """Write x.vti, which can be drawn, and files that cannot, and return their folder.

    The folder is the current one.
    """
    monkeypatch.chdir(tmp_path)
    surface_file(tmp_path / "x.vti")
    write_image("line.vti", {"gap": np.ones(4)}, (1e-6,), {})
    bare = pv.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid()
    bare.point_data["displacement"] = np.ones((8, 3))
    bare.save("bare.vtu")
    texts = {
        "x.csv": "",
        "text.vtu": "text",
        "empty.pvd": "",
        "xml.pvd": "<a/>",
        "bem.json": "{}",
    }
    for name, text in texts.items():
        Path(name).write_text(text)
    return tmp_path


def stretch(factor):
    """Return `screenshot` that stretches displacements by a factor."""
    return functools.partial(view.screenshot, factor=factor)


#: Files that `screenshot` refuses, and a part of the message.
NOT_DRAWN = {
    "gone.vti": "no such file",
    "x.csv": r"a \.vti, \.vtu, \.pvd",
    "line.vti": "line.vti holds no field pressure, only gap",
    "text.vtu": "is damaged or holds no cells",
    "bare.vtu": "no von Mises stress or plastic strain",
    "empty.pvd": "it is no ParaView collection",
    "xml.pvd": "it names no file",
    "bem.json": "no fields lie beside",
}


@pytest.mark.parametrize(
    ("sentence", "call", "arguments"),
    [
        (r"must be named \.png", view.screenshot, ("x.vti", "x.jpg")),
        ("is a line", view.show, ("line.vti",)),
        ("is a line", view.animate, (["x.vti", "line.vti"], "x.gif")),
        ("they are lines", view.compare, ("line.vti", "line.vti", "x.png")),
        (
            "are of 80 x 60 points and 4 points",
            view.compare,
            ("x.vti", "line.vti", "x.png"),
        ),
        (r"must be named \.gif or \.mp4", view.animate, (["x.vti"], "x.avi")),
        ("load steps", view.animate, ([], "x.gif")),
        ("must be positive", stretch(math.nan), ("x.vti", "x.png")),
        ("here at most", stretch(1e300), ("x.vti", "x.png")),
        *(
            (sentence, view.screenshot, (name, "x.png"))
            for name, sentence in NOT_DRAWN.items()
        ),
    ],
)
@pytest.mark.usefixtures("some_files")
def test_what_is_refused(sentence, call, arguments):
    """`call` raises OutputError with `sentence`, and writes no file."""
    before = os.listdir()
    with pytest.raises(OutputError, match=sentence):
        call(*arguments)
    assert os.listdir() == before


def test_a_json_stands_for_the_fields_of_its_only_or_first_surface(some_files):
    """The fields of bem.json lie in bem.vti, or else in the file of the first surface
    by name.
    """
    for name in ("bem-seed9", "bem-seed8", "bem"):
        (some_files / f"{name}.vti").touch()
        assert view.find_result("bem.json").name == f"{name}.vti"


@pytest.mark.parametrize(
    ("quotient", "factor"),
    [(1.99, 1), (4.99, 2), (5, 5), (0.06, 0.05), (math.nan, 1), (0.0, 1)],
)
def test_factors_are_round(quotient, factor):
    """A factor is `quotient` rounded down to 1, 2 or 5 times a power of ten.

    Between 0.7 and 2, for no number and for a length of 0 it is 1.
    """
    assert drawing.round_factor(quotient, 1.0) == pytest.approx(factor)
    assert drawing.round_factor(1.0, 0.0) == 1.0
