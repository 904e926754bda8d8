"""Views: drawn without noise, from files alone; what cannot be drawn is refused in one sentence."""

from __future__ import annotations

import importlib.util
import itertools
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from command_line import python
from PIL import Image

from epcontact.errors import OutputError
from epcontact.output import drawing, view
from epcontact.output.vtk import write_image

YELLOW, BLACK = (240, 196, 25), (0, 0, 0)
NO_MP4 = importlib.util.find_spec("imageio_ffmpeg") is None


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


def amount(image: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int(np.sum(np.abs(image - np.array(colour)).max(axis=2) < 12))


@pytest.mark.usefixtures("can_draw")
def test_a_surface_shows_elastic_yellow_and_plastic_black(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "out" / "x.png"
    view.screenshot(surface_file(tmp_path / "bem.vti"), picture, size=(800, 400))
    image = pixels(picture)
    assert image.shape == (400, 800, 3)
    left, right = image[40:300, :400], image[40:300, 400:]
    assert min(amount(left, YELLOW), amount(left, BLACK)) > 1000
    assert amount(right, YELLOW) < 100  # the pressure's yellow is another one
    # Contact lies left of the middle of the surface.
    columns = np.argwhere(np.abs(left - np.array(BLACK)).max(axis=2) < 12)[:, 1]
    assert columns.mean() < 190
    assert capfd.readouterr() == ("", "")
    assert os.listdir(tmp_path / "out") == ["x.png"]


def test_two_results_and_their_difference(tmp_path: Path) -> None:
    files = [surface_file(tmp_path / f"{n}.vti", r) for n, r in (("bem", 0.3), ("fem", 0.2))]
    view.compare(*files, tmp_path / "x.png")
    image = pixels(tmp_path / "x.png")
    panels = np.split(image[:, : image.shape[1] // 3 * 3], 3, axis=1)
    dark = [amount(panel, (68, 1, 84)) for panel in panels]  # the upper end of the pressure map
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
            frames = [(film.seek(k), np.asarray(film.convert("RGB")))[1] for k in range(count)]
        assert all(np.any(a != b) for a, b in itertools.pairwise(frames))
    for factor in (1.0, 300.0):
        view.screenshot(path, tmp_path / f"{factor}.png", factor=factor, size=(600, 300))
    one, many = (pixels(tmp_path / f"{factor}.png")[30:] for factor in (1.0, 300.0))
    assert np.ptp(one, axis=(0, 1)).min() > 100
    assert amount(one, (255, 255, 255)) > 0.2 * one.shape[0] * one.shape[1]
    assert np.mean(np.any(one != many, axis=2)) > 0.05
    if NO_MP4:
        with pytest.raises(OutputError, match=r"imageio-ffmpeg.*\.gif"):
            view.animate(surfaces, tmp_path / "x.mp4", size=(100, 50))
        assert not (tmp_path / "x.mp4").exists()


def line_file(path: Path, **fields: Any) -> Path:
    write_image(path, fields, (1e-6,), {})
    return path


def test_a_line_is_drawn_without_vtk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "draw", lambda *_: pytest.fail("VTK was asked"))
    pressure = np.maximum(np.sin(np.arange(50) / 5), 0)
    state = (pressure > 0) + (pressure > 0.8)
    line = line_file(tmp_path / "x.vti", pressure=pressure, gap=1 - pressure, state=state)
    view.screenshot(line, tmp_path / "x.png")
    assert amount(pixels(tmp_path / "x.png"), BLACK) > 50


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="these windows are Linux's")
@pytest.mark.parametrize(
    ("call", "display", "window", "words"),
    [
        ("show('x.vti')", "", "", "no window can be opened without a display"),
        ("show('x.vti')", ":7531", "", "no window can be opened without a display"),
        ("screenshot('x.vti', 'x.png')", "", "vtkOSOpenGLRenderWindow", "no display, EGL or OSM"),
    ],
)
def test_where_nothing_can_be_drawn(
    tmp_path: Path, call: str, display: str, window: str, words: str
) -> None:
    """VTK would draw where nobody sees it, warn on the terminal, or crash without its libraries."""
    if "OSM" in window and drawing.ctypes.util.find_library("OSMesa"):
        pytest.skip("OSMesa is installed")
    surface_file(tmp_path / "x.vti")
    code = f"from epcontact.output.view import *\ntry: {call}\nexcept OutputError as e: print(e)"
    told = {"DISPLAY": display} | ({"VTK_DEFAULT_OPENGL_WINDOW": window} if window else {})
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = python("-c", code, cwd=tmp_path, env=kept | told)
    assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)
    assert words in done.stdout
    assert os.listdir(tmp_path) == ["x.vti"]


REFUSED: list[tuple[Any, tuple[Any, ...], str]] = [
    (view.screenshot, ("gone.vti", "x.png"), "no such file"),
    (view.screenshot, ("x.csv", "x.png"), r"a \.vti, \.vtu, \.pvd"),
    (view.screenshot, ("x.vti", "x.jpg"), r"must be named \.png"),
    (view.screenshot, ("gap.vti", "x.png"), "gap.vti holds no field pressure, only gap"),
    (view.screenshot, ("line.vti", "x.png"), "line.vti holds no field state, only gap"),
    (view.screenshot, ("text.vtu", "x.png"), "is damaged or holds no cells"),
    (view.screenshot, ("bare.vtu", "x.png"), "no von Mises stress or plastic strain"),
    (view.show, ("line.vti",), "is a line"),
    (view.animate, (["x.vti"], "x.avi"), r"must be named \.gif or \.mp4"),
    (view.animate, ([], "x.gif"), "load steps"),
    (view.compare, ("x.vti", "gap.vti", "x.png"), "cannot compare"),
    (view.load_steps, ("empty.pvd",), "it is no ParaView collection"),
    (view.load_steps, ("xml.pvd",), "it names no file"),
    (view.load_steps, ("nameless.pvd",), "it is no ParaView collection"),
    (view.load_steps, ("gone.pvd",), "no such file"),
    (view.find_result, ("bem.json",), "no fields lie beside"),
]


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    surface_file(tmp_path / "x.vti")
    write_image("gap.vti", {"gap": np.ones((4, 4))}, (1.0, 1.0), {})
    line_file(tmp_path / "line.vti", gap=np.ones(4))
    pv.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid().save("bare.vtu")
    nameless = "<VTKFile><Collection><DataSet/></Collection></VTKFile>"
    texts = {"x.csv": "", "text.vtu": "nothing", "empty.pvd": "", "xml.pvd": "<a/>",
             "nameless.pvd": nameless, "bem.json": "{}"}  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    before = os.listdir()
    for call, arguments, sentence in REFUSED:
        with pytest.raises(OutputError, match=sentence):
            call(*arguments)
        assert os.listdir() == before
    for name in ("bem-seed9", "bem-seed8", "bem"):  # the first surface, or the only one
        (tmp_path / f"{name}.vti").touch()
        assert view.find_result("bem.json").name == f"{name}.vti"


@pytest.mark.parametrize(
    ("value", "rounded"),
    [(1.99, 1), (0.8, 1), (2, 2), (4.99, 2), (5, 5), (37, 20), (0.06, 0.05), (1000, 1000),
     (float("nan"), 1), (0.0, 1)],
)  # fmt: skip
def test_factors_are_round(value: float, rounded: float) -> None:
    assert drawing.round_factor(value, 1.0) == pytest.approx(rounded)
    assert drawing.round_factor(1.0, 0.0) == 1.0
