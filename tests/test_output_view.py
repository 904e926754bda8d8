"""Views: drawn without noise, from files alone; what cannot be drawn is refused in one sentence."""

from __future__ import annotations

import importlib.util
import itertools
import math
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from command_line import python
from PIL import Image, ImageSequence

from epcontact.errors import OutputError
from epcontact.output import drawing, view
from epcontact.output.vtk import write_image

YELLOW, BLACK = (240, 196, 25), (0, 0, 0)
NO_WINDOW = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkOSOpenGLRenderWindow"}


@pytest.fixture(scope="session")
def can_draw(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("can-draw")
    try:
        view.screenshot(surface_file(folder / "x.vti"), folder / "x.png", size=(80, 40))
    except OutputError as error:
        pytest.skip(str(error))


def surface_file(path: Path, radius: float = 0.3) -> Path:
    """One round contact, black within yellow, left of the middle."""
    x, y = np.meshgrid(*(np.arange(n) / n for n in (80, 60)), indexing="ij")
    top = radius**2 - (x - 0.3) ** 2 - (y - 0.5) ** 2
    pressure = np.clip(3e10 * top / radius**2, 0, 1.5e10)
    state = np.where(pressure >= 1.5e10, 2, np.where(pressure > 0, 1, 0))
    fields = {"pressure": pressure, "gap": np.where(top > 0, 0.0, -1e-5 * top), "state": state}
    write_image(path, fields, (1e-6, 1e-6), {"method": path.stem, "hardness": 1.5e10})
    return path


def block_file(path: Path, load: float = 1.0) -> Path:
    axis = np.linspace(0.0, 1e-5, 9)
    mesh = pv.RectilinearGrid(axis, axis, axis[::2] - 1e-5).cast_to_unstructured_grid()
    depth = np.exp(mesh.points[:, 2] / 3e-6)
    mesh.point_data["displacement"] = -1e-8 * load * depth[:, None] * np.array([0.0, 0.0, 1.0])
    mesh.point_data["von_mises"] = 1e9 * load * depth
    mesh.cell_data["equivalent_plastic_strain"] = np.linspace(0, 0.01 * load, mesh.n_cells)
    mesh.save(path)
    return path


def pixels(picture: Path) -> np.ndarray:
    with Image.open(picture) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def has(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """The pixels of a colour."""
    return np.abs(image - np.array(colour)).max(axis=2) < 12


@pytest.mark.usefixtures("can_draw")
def test_a_surface_shows_elastic_yellow_and_plastic_black(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "out" / "x.png"
    view.screenshot(surface_file(tmp_path / "bem.vti"), picture, size=(800, 400))
    image = pixels(picture)
    assert image.shape == (400, 800, 3)
    left, right = image[40:300, :400], image[40:300, 400:]
    assert min(has(left, YELLOW).sum(), has(left, BLACK).sum()) > 1000
    assert has(right, YELLOW).sum() < 100  # the pressure's yellow is another one
    assert np.argwhere(has(left, BLACK))[:, 1].mean() < 190  # left of the middle of the surface
    assert capfd.readouterr() == ("", "")
    assert os.listdir(tmp_path / "out") == ["x.png"]


def test_two_results_and_their_difference(tmp_path: Path) -> None:
    files = [surface_file(tmp_path / f"{n}.vti", r) for n, r in (("bem", 0.3), ("fem", 0.2))]
    view.compare(*files, tmp_path / "x.png")
    panels = np.array_split(pixels(tmp_path / "x.png"), 3, axis=1)
    dark = [has(panel, (68, 1, 84)).sum() for panel in panels]  # the end of the pressure map
    assert dark[0] > 1.5 * dark[1] > 0
    red = [int(np.sum((p[..., 0] > p[..., 2] + 60) & (p[..., 1] < 120))) for p in panels]
    assert red[2] > 200 > max(red[:2])


@pytest.mark.usefixtures("can_draw")
def test_films_and_blocks_show_each_load_in_one_scale(tmp_path: Path) -> None:
    blocks = [block_file(tmp_path / f"{load}.vtu", load) for load in (3.0, 2.0, 1.0)]
    steps = "".join(f'<DataSet timestep="{-k}" file="{f.name}"/>' for k, f in enumerate(blocks))
    path = tmp_path / "fem.pvd"
    path.write_text(f"<VTKFile><Collection>{steps}</Collection></VTKFile>")
    assert view.load_steps(path) == blocks[::-1]
    surfaces = [surface_file(tmp_path / f"{r}.vti", r) for r in (0.1, 0.2)]
    for sources, count in (([path], 3), (surfaces, 2)):
        view.animate(sources, tmp_path / "x.gif", size=(400, 200))
        with Image.open(tmp_path / "x.gif") as film:
            assert (film.n_frames, film.info["loop"]) == (count, 0)
            frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
        assert all(np.any(a != b) for a, b in itertools.pairwise(frames))
    for factor in (1.0, 300.0):
        view.screenshot(path, tmp_path / f"{factor}.png", factor=factor, size=(600, 300))
    one, many = (pixels(tmp_path / f"{factor}.png")[30:] for factor in (1.0, 300.0))
    assert has(one, (255, 255, 255)).mean() > 0.2
    assert np.mean(np.any(one != many, axis=2)) > 0.05
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        with pytest.raises(OutputError, match=r"imageio-ffmpeg.*\.gif"):
            view.animate(surfaces, tmp_path / "x.mp4", size=(100, 50))


def test_a_line_is_drawn_without_vtk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "draw", lambda *_: pytest.fail("VTK was asked"))
    pressure = np.maximum(np.sin(np.arange(50) / 5), 0)
    fields = {"pressure": pressure, "gap": 1 - pressure, "state": np.ceil(2 * pressure)}
    write_image(tmp_path / "x.vti", fields, (1e-6,), {})
    view.screenshot(tmp_path / "x.vti", tmp_path / "x.png")
    assert has(pixels(tmp_path / "x.png"), BLACK).sum() > 50


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="these windows are Linux's")
@pytest.mark.parametrize(
    ("call", "told", "words"),
    [
        ("show('x.vti')", {}, "no window can be opened without a display"),
        ("show('x.vti')", {"DISPLAY": ":7531"}, "no window can be opened without a display"),
        ("screenshot('x.vti', 'x.png')", NO_WINDOW, "no display, EGL or OSM"),
    ],
)
def test_where_nothing_can_be_drawn(tmp_path: Path, call: str, told: Any, words: str) -> None:
    """VTK would draw where nobody sees it, warn on the terminal, or crash without its libraries."""
    if told == NO_WINDOW and drawing.ctypes.util.find_library("OSMesa"):
        pytest.skip("OSMesa is installed")
    surface_file(tmp_path / "x.vti")
    code = f"from epcontact.output.view import *\ntry: {call}\nexcept OutputError as e: print(e)"
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = python("-c", code, cwd=tmp_path, env=kept | told)
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)
    assert words in done.stdout
    assert os.listdir(tmp_path) == ["x.vti"]


REFUSED: list[tuple[Any, tuple[Any, ...], str]] = [
    (view.screenshot, ("gone.vti", "x.png"), "no such file"),
    (view.screenshot, ("x.csv", "x.png"), r"a \.vti, \.vtu, \.pvd"),
    (view.screenshot, ("x.vti", "x.jpg"), r"must be named \.png"),
    (view.screenshot, ("line.vti", "x.png"), "line.vti holds no field state, only gap"),
    (view.screenshot, ("text.vtu", "x.png"), "is damaged or holds no cells"),
    (view.screenshot, ("bare.vtu", "x.png"), "no von Mises stress or plastic strain"),
    (view.show, ("line.vti",), "is a line"),
    (view.animate, (["x.vti"], "x.avi"), r"must be named \.gif or \.mp4"),
    (view.animate, ([], "x.gif"), "load steps"),
    (view.compare, ("x.vti", "line.vti", "x.png"), "cannot compare"),
    (view.load_steps, ("empty.pvd",), "it is no ParaView collection"),
    (view.load_steps, ("xml.pvd",), "it names no file"),
    (view.find_result, ("bem.json",), "no fields lie beside"),
]


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    surface_file(tmp_path / "x.vti")
    write_image("line.vti", {"gap": np.ones(4)}, (1e-6,), {})
    pv.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid().save("bare.vtu")
    texts = {"x.csv": "", "text.vtu": "text", "empty.pvd": "", "xml.pvd": "<a/>", "bem.json": "{}"}
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


def test_factors_are_round() -> None:
    values, rounded = [1.99, 4.99, 5, 37, 0.06, math.nan, 0.0], [1, 2, 5, 20, 0.05, 1, 1]
    assert [drawing.round_factor(v, 1.0) for v in values] == pytest.approx(rounded)
    assert drawing.round_factor(1.0, 0.0) == 1.0
