"""Field files and their views: what was written is read back, by us and by pyvista, and
drawn.

Views are drawn without noise, from files alone; what cannot be drawn is refused in one
sentence.
"""

import importlib.util
import itertools
import math
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
import pyvista as pv
from command_line import python
from PIL import Image, ImageSequence

from epcontact.errors import OutputError
from epcontact.output import drawing, view
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

# Heights that are told apart at a glance are steep.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

HARDNESS = 5e8
PERIODS = (6e-6, 2e-4)


def asymmetric(shape):
    """Fields that no transposition, reflection or shift maps on themselves."""
    heights = 1e-6 * np.random.default_rng(20260721).standard_normal(shape)
    pressure = np.clip(heights * 1e15, 0, HARDNESS)
    state = np.where(
        pressure >= HARDNESS, PLASTIC, np.where(pressure > 0, ELASTIC, APART)
    )
    areas = {"raw": Areas(0.3, 0.1, 0.2), "corrected": Areas(0.28, 0.11, 0.17)}
    step = LoadStep(1.25e8, areas, {"gap": 1.5e-9}, {"newton": 4}, {"mean_gap": 2e-7})
    fields = {
        "heights": heights,
        "pressure": pressure,
        "gap": -0.3 * heights,
        "displacement": 2 * heights + 1e-7,
        "state": state.astype(np.int8),
    }
    made = Provenance("digest", 7, {"law": "capped", "levels": [1, 2]})
    return ContactResult("bem", (step,), made, fields=fields)


def write(path, result, *rest, **options):
    """Write a result, and read it back."""
    heights = result.fields.get("heights", np.eye(5, 3))
    write_fields(
        path,
        result,
        Surface(heights, PERIODS[: heights.ndim], seed=7),
        *rest,
        **options,
    )
    return read_fields(path)


def test_every_value_is_at_its_place_in_single_and_double_precision(tmp_path):
    result = asymmetric((6, 100))  # more columns than are copied at a time
    path = tmp_path / "out" / "bem.vti"
    single = write(path, result, {"hardness": HARDNESS})
    double = write(tmp_path / "double.vti", result, precision="double")
    image = pv.read(path)
    assert (image.dimensions, image.origin) == ((6, 100, 1), (0, 0, 0))
    assert (image.spacing[:2], image.active_scalars_name) == ((1e-6, 2e-6), "pressure")
    assert set(image.point_data.keys()) == set(result.fields)
    i, j = np.rint(image.points[:, :2] / image.spacing[:2]).astype(int).T
    for name, field in result.fields.items():
        assert np.array_equal(image.point_data[name], np.float32(field[i, j]))
        kind = np.uint8 if name == "state" else np.float32
        assert single.fields[name].dtype == kind
        assert np.array_equal(single.fields[name], field.astype(kind))
        assert np.array_equal(double.fields[name], field)
    assert image.field_data["hardness"][0] == HARDNESS
    assert image.field_data["unit.pressure"][0] == "Pa"
    head = (
        path.read_bytes().partition(b"<AppendedData")[0].decode()
    )  # what ParaView shows
    labels = dict(
        re.findall(r'Name="(\w+)"[^>]*><Info[^>]*UNITS_LABEL[^>]*>([^<]+)<', head)
    )
    assert labels == dict.fromkeys(result.fields, "m") | {
        "pressure": "Pa",
        "state": "1",
    }
    assert single.periods == pytest.approx(PERIODS, rel=1e-15)
    told = {"version.numpy": np.__version__, "option.levels": "[1, 2]", "seed": 7}
    told |= {"residual.gap": 1.5e-9, "iterations.newton": 4}
    assert told.items() <= single.attributes.items()


def test_spacing_and_numbers_keep_every_bit(tmp_path):
    spacing = (2.513274e-4 / 1024, math.pi * 1e-7)
    attributes = {
        "third": 1 / 3,
        "inf": math.inf,
        "big": 2**100,
        "seed": 2**62 + 1,
        "empty": "",
        '<a> & "b"': "<c> & 'd'",
    }
    write_image(tmp_path / "x.vti", {"a": np.ones((3, 2))}, spacing, attributes)
    read = read_fields(tmp_path / "x.vti")
    assert read.spacing == spacing
    assert read.attributes == {**attributes, "big": str(2**100)}


@pytest.mark.parametrize("shape", [(6, 4), (7,)])
def test_a_displacement_that_follows_from_the_rest_is_left_out(shape, tmp_path):
    result = asymmetric(shape)
    displacement = 0.7 * result.fields["heights"] - 3e-7  # under a flat
    result.fields["displacement"] = displacement
    read = write(tmp_path / "x.vti", result)
    assert read.fields.keys() == result.fields.keys() - {"displacement"}
    assert (read.shape, read.units["flat_height"]) == (shape, "m")
    restored = (
        read.fields["gap"] + read.fields["heights"] - read.attributes["flat_height"]
    )
    assert restored == pytest.approx(displacement, abs=1e-6 * np.ptp(displacement))


def test_what_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    for error, sentence, path, fields in (
        (OutputError, "bem gives no fields", "x.vti", {}),
        (OutputError, r"must be named \.vti", "x.vtk", {"gap": np.ones((5, 3))}),
        (ValueError, "lie on no grid", "x.vti", {"gap": np.ones((4, 5))}),
        (OutputError, "file", "file/x.vti", {"gap": np.ones((5, 3))}),
    ):
        with pytest.raises(error, match=sentence):
            write(tmp_path / path, replace(asymmetric((5, 3)), fields=fields))
        assert os.listdir(tmp_path) == ["file"]


def test_what_cannot_be_read(tmp_path, capfd):
    path = tmp_path / "x.vti"
    with pytest.raises(OutputError, match="no such file"):
        read_fields(path)
    write(path, asymmetric((6, 100)), {"hardness": HARDNESS})
    whole = path.read_bytes()
    spoilt = {b"not a picture of anything": "no VTK image file"}
    spoilt |= {whole.replace(b"</Piece>", b"</Peace>"): "damaged"}
    spoilt |= {whole[: k * len(whole) // 40]: "cannot read" for k in range(40)}
    for content, sentence in spoilt.items():
        path.write_bytes(content)
        with pytest.raises(OutputError, match=sentence):
            read_fields(path)
    assert capfd.readouterr() == ("", "")


# --- views
# ----------------------------------------------------------------------------------------

YELLOW, BLACK = (240, 196, 25), (0, 0, 0)
NO_WINDOW = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkOSOpenGLRenderWindow"}


@pytest.fixture(scope="session")
def can_draw(tmp_path_factory):
    folder = tmp_path_factory.mktemp("can-draw")
    try:
        view.screenshot(surface_file(folder / "x.vti"), folder / "x.png", size=(80, 40))
    except OutputError as error:
        pytest.skip(str(error))


def surface_file(path, radius=0.3):
    """One round contact, black within yellow, left of the middle."""
    x, y = np.meshgrid(*(np.arange(n) / n for n in (80, 60)), indexing="ij")
    top = radius**2 - (x - 0.3) ** 2 - (y - 0.5) ** 2
    pressure = np.clip(3e10 * top / radius**2, 0, 1.5e10)
    state = np.where(pressure >= 1.5e10, 2, np.where(pressure > 0, 1, 0))
    fields = {
        "pressure": pressure,
        "gap": np.where(top > 0, 0.0, -1e-5 * top),
        "state": state,
    }
    write_image(path, fields, (1e-6, 1e-6), {"method": path.stem, "hardness": 1.5e10})
    return path


def block_file(path, load=1.0):
    axis = np.linspace(0.0, 1e-5, 9)
    mesh = pv.RectilinearGrid(axis, axis, axis[::2] - 1e-5).cast_to_unstructured_grid()
    depth = np.exp(mesh.points[:, 2] / 3e-6)
    mesh.point_data["displacement"] = (
        -1e-8 * load * depth[:, None] * np.array([0.0, 0.0, 1.0])
    )
    mesh.point_data["von_mises"] = 1e9 * load * depth
    mesh.cell_data["equivalent_plastic_strain"] = np.linspace(
        0, 0.01 * load, mesh.n_cells
    )
    mesh.save(path)
    return path


def pixels(picture):
    with Image.open(picture) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def has(image, colour):
    """The pixels of a colour."""
    return np.abs(image - np.array(colour)).max(axis=2) < 12


@pytest.mark.usefixtures("can_draw")
def test_a_surface_shows_elastic_yellow_and_plastic_black(tmp_path, capfd):
    picture = tmp_path / "out" / "x.png"
    view.screenshot(surface_file(tmp_path / "bem.vti"), picture, size=(800, 400))
    image = pixels(picture)
    assert image.shape == (400, 800, 3)
    left, right = image[40:300, :400], image[40:300, 400:]
    assert min(has(left, YELLOW).sum(), has(left, BLACK).sum()) > 1000
    assert has(right, YELLOW).sum() < 100  # the pressure's yellow is another one
    assert (
        np.argwhere(has(left, BLACK))[:, 1].mean() < 190
    )  # left of the middle of the surface
    assert capfd.readouterr() == ("", "")
    assert os.listdir(tmp_path / "out") == ["x.png"]


def test_two_results_and_their_difference(tmp_path):
    files = [
        surface_file(tmp_path / f"{n}.vti", r) for n, r in (("bem", 0.3), ("fem", 0.2))
    ]
    view.compare(*files, tmp_path / "x.png")
    panels = np.array_split(pixels(tmp_path / "x.png"), 3, axis=1)
    dark = [
        has(panel, (68, 1, 84)).sum() for panel in panels
    ]  # the end of the pressure map
    assert dark[0] > 1.5 * dark[1] > 0
    red = [
        int(np.sum((p[..., 0] > p[..., 2] + 60) & (p[..., 1] < 120))) for p in panels
    ]
    assert red[2] > 200 > max(red[:2])


@pytest.mark.usefixtures("can_draw")
def test_films_and_blocks_show_each_load_in_one_scale(tmp_path):
    blocks = [block_file(tmp_path / f"{load}.vtu", load) for load in (2.0, 3.0, 1.0)]
    steps = "".join(
        f'<DataSet timestep="{-k}" file="{f.name}"/>' for k, f in enumerate(blocks)
    )
    path = tmp_path / "fem.pvd"
    path.write_text(f"<VTKFile><Collection>{steps}</Collection></VTKFile>")
    assert view.load_steps(path) == blocks[::-1]
    surfaces = [surface_file(tmp_path / f"{r}.vti", r) for r in (0.1, 0.2)]
    for sources, count in (([path], 3), (surfaces, 2)):
        view.animate(sources, tmp_path / "x.gif", size=(400, 200))
        with Image.open(tmp_path / "x.gif") as film:
            assert (film.n_frames, film.info["loop"], film.info["duration"]) == (
                count,
                0,
                330,
            )
            frames = [
                np.asarray(frame.convert("RGB"))
                for frame in ImageSequence.Iterator(film)
            ]
        assert all(np.any(a != b) for a, b in itertools.pairwise(frames))
    with mock.patch.object(drawing, "draw_block", wraps=drawing.draw_block) as each:
        view.animate(
            blocks, tmp_path / "x.gif", size=(200, 100)
        )  # of which the second is the peak
    peak = drawing.block_scale(drawing.read_block(blocks[1]))[1]
    assert [call.args[3] for call in each.call_args_list] == [peak] * 3
    for factor in (1.0, 300.0):
        view.screenshot(
            path, tmp_path / f"{factor}.png", factor=factor, size=(600, 300)
        )
    one, many = (pixels(tmp_path / f"{factor}.png")[30:] for factor in (1.0, 300.0))
    assert has(one, (255, 255, 255)).mean() > 0.2
    assert np.mean(np.any(one != many, axis=2)) > 0.05
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        with pytest.raises(OutputError, match=r"imageio-ffmpeg.*\.gif"):
            view.animate(surfaces, tmp_path / "x.mp4", size=(100, 50))


def test_a_line_is_drawn_without_vtk(tmp_path, monkeypatch):
    monkeypatch.setattr(drawing, "draw", lambda *_: pytest.fail("VTK was asked"))
    pressure = np.maximum(np.sin(np.arange(50) / 5), 0)
    fields = {"pressure": pressure, "gap": 1 - pressure, "state": np.ceil(2 * pressure)}
    steps = [tmp_path / "1.vti", tmp_path / "2.vti"]
    for path, times in zip(steps, (1, 2), strict=True):
        write_image(path, fields | {"pressure": times * pressure}, (1e-6,), {})
    view.screenshot(steps[0], tmp_path / "x.png")
    assert has(pixels(tmp_path / "x.png"), BLACK).sum() > 50
    view.animate(steps, tmp_path / "x.gif")
    with Image.open(tmp_path / "x.gif") as film:
        frames = [
            np.asarray(f.convert("RGB"), dtype=int)
            for f in ImageSequence.Iterator(film)
        ]
    one, two = (has(frame, (0, 114, 178)).sum() for frame in frames)
    assert 1.8 < two / one < 2.2  # in one scale


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="these windows are Linux's"
)
@pytest.mark.parametrize(
    ("call", "told", "words"),
    [
        (
            "show('x.vti')",
            {"DISPLAY": ":7531"},
            "no window can be opened without a display",
        ),
        ("screenshot('x.vti', 'x.png')", NO_WINDOW, "no display, EGL or OSM"),
    ],
)
def test_where_nothing_can_be_drawn(tmp_path, call, told, words):
    """VTK would draw where nobody sees it, warn on the terminal, or crash without its
    libraries.
    """
    if told == NO_WINDOW and drawing.ctypes.util.find_library("OSMesa"):
        pytest.skip("OSMesa is installed")
    surface_file(tmp_path / "x.vti")
    code = f"from epcontact.output.view import *\ntry: {call}\nexcept OutputError as e: print(e)"
    kept = {
        k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    done = python("-c", code, cwd=tmp_path, env=kept | told)
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)
    assert words in done.stdout
    assert os.listdir(tmp_path) == ["x.vti"]


REFUSED: list[tuple[Any, tuple[Any, ...], str]] = [
    (view.screenshot, ("gone.vti", "x.png"), "no such file"),
    (view.screenshot, ("x.csv", "x.png"), r"a \.vti, \.vtu, \.pvd"),
    (view.screenshot, ("x.vti", "x.jpg"), r"must be named \.png"),
    (
        view.screenshot,
        ("line.vti", "x.png"),
        "line.vti holds no field pressure, only gap",
    ),
    (view.screenshot, ("text.vtu", "x.png"), "is damaged or holds no cells"),
    (view.screenshot, ("bare.vtu", "x.png"), "no von Mises stress or plastic strain"),
    (
        lambda *a: view.screenshot(*a, factor=math.nan),
        ("x.vti", "x.png"),
        "must be positive",
    ),
    (lambda *a: view.screenshot(*a, factor=1e300), ("x.vti", "x.png"), "here at most"),
    (view.show, ("line.vti",), "is a line"),
    (view.animate, (["x.vti", "line.vti"], "x.gif"), "is a line"),
    (view.compare, ("line.vti", "line.vti", "x.png"), "they are lines"),
    (view.animate, (["x.vti"], "x.avi"), r"must be named \.gif or \.mp4"),
    (view.animate, ([], "x.gif"), "load steps"),
    (
        view.compare,
        ("x.vti", "line.vti", "x.png"),
        r"are of 80 x 60 points and 4 points",
    ),
    (view.load_steps, ("empty.pvd",), "it is no ParaView collection"),
    (view.load_steps, ("xml.pvd",), "it names no file"),
    (view.find_result, ("bem.json",), "no fields lie beside"),
]


def test_what_is_refused(tmp_path, monkeypatch):
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
    before = os.listdir()
    for call, arguments, sentence in REFUSED:
        with pytest.raises(OutputError, match=sentence):
            call(*arguments)
        assert os.listdir() == before
    for name in ("bem-seed9", "bem-seed8", "bem"):  # the first surface, or the only one
        (tmp_path / f"{name}.vti").touch()
        assert view.find_result("bem.json").name == f"{name}.vti"


def test_factors_are_round():
    values, rounded = (
        [1.99, 4.99, 5, 37, 0.06, math.nan, 0.0],
        [1, 2, 5, 20, 0.05, 1, 1],
    )
    assert [drawing.round_factor(v, 1.0) for v in values] == pytest.approx(rounded)
    assert drawing.round_factor(1.0, 0.0) == 1.0
