"""Views: drawn in another process, without noise, from files alone; refused in one sentence."""

from __future__ import annotations

import importlib.util
import itertools
import os
import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from PIL import Image

from epcontact.errors import OutputError
from epcontact.output import view
from epcontact.output.drawing import round_factor
from epcontact.output.vtk import write_image

YELLOW, BLACK = (240, 196, 25), (0, 0, 0)


@pytest.fixture(scope="session")
def can_draw(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("can-draw")
    try:
        view.screenshot(surface_file(folder / "x.vti"), folder / "x.png", size=(80, 40))
    except OutputError as error:
        pytest.skip(str(error))


def surface_file(path: Path, *, radius: float = 0.3, at: tuple[float, float] = (0.3, 0.5)) -> Path:
    """One round contact, black within yellow, left of the middle."""
    x, y = np.meshgrid(*(np.arange(n) / n for n in (80, 60)), indexing="ij")
    top = radius**2 - (x - at[0]) ** 2 - (y - at[1]) ** 2
    pressure = np.clip(3e10 * top / radius**2, 0, 1.5e10)
    fields = {
        "pressure": pressure,
        "gap": np.where(top > 0, 0.0, -1e-5 * top),
        "state": np.where(pressure >= 1.5e10, 2, np.where(pressure > 0, 1, 0)),
    }
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


def collection_file(path: Path, steps: dict[float, Path]) -> Path:
    lines = [f'<DataSet timestep="{t}" file="{f.name}"/>' for t, f in steps.items()]
    path.write_text(f"<VTKFile><Collection>{''.join(lines)}</Collection></VTKFile>")
    return path


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


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
    assert amount(left, YELLOW) > 1000
    assert amount(left, BLACK) > 1000
    assert amount(right, YELLOW) < 100  # the pressure's yellow is another one
    # Contact lies left of the middle of the surface.
    columns = np.argwhere(np.abs(left - np.array(BLACK)).max(axis=2) < 12)[:, 1]
    assert columns.mean() < 190
    assert capfd.readouterr() == ("", "")
    assert sorted(os.listdir(tmp_path)) == ["bem.vti", "out"]
    assert os.listdir(tmp_path / "out") == ["x.png"]


@pytest.mark.slow
@pytest.mark.usefixtures("can_draw")
def test_a_block_shows_stress_and_strain_deformed_by_the_factor(tmp_path: Path) -> None:
    block = block_file(tmp_path / "fem.vtu")
    for name, factor in (("one", 1.0), ("many", 300.0)):
        view.screenshot(block, tmp_path / f"{name}.png", factor=factor, size=(600, 300))
    one, many = (pixels(tmp_path / f"{name}.png")[30:] for name in ("one", "many"))
    assert np.ptp(one, axis=(0, 1)).min() > 100
    assert amount(one, (255, 255, 255)) > 0.2 * one.shape[0] * one.shape[1]
    assert np.mean(np.any(one != many, axis=2)) > 0.05


@pytest.mark.slow
@pytest.mark.usefixtures("can_draw")
def test_two_results_and_their_difference(tmp_path: Path) -> None:
    files = [surface_file(tmp_path / f"{n}.vti", radius=r) for n, r in (("bem", 0.3), ("fem", 0.2))]
    view.compare(*files, tmp_path / "x.png", size=(900, 350))
    panels = np.split(pixels(tmp_path / "x.png")[30:280], 3, axis=1)
    dark = [amount(panel, (68, 1, 84)) for panel in panels]  # the upper end of the pressure map
    assert dark[0] > 1.5 * dark[1] > 0
    red = [int(np.sum((p[..., 0] > p[..., 2] + 60) & (p[..., 1] < 120))) for p in panels]
    assert red[2] > 200 > max(red[:2])


@pytest.mark.slow
@pytest.mark.usefixtures("can_draw")
def test_films(tmp_path: Path) -> None:
    steps = {load: block_file(tmp_path / f"{load}.vtu", load) for load in (1.0, 2.0, 3.0)}
    view.animate(
        [collection_file(tmp_path / "fem.pvd", steps)], tmp_path / "block.gif", size=(400, 200)
    )
    surfaces = [surface_file(tmp_path / f"{r}.vti", radius=r) for r in (0.1, 0.2)]
    view.animate(surfaces, tmp_path / "surface.gif", size=(400, 200))
    for name, count in (("block", 3), ("surface", 2)):
        frames = []
        with Image.open(tmp_path / f"{name}.gif") as film:
            assert film.n_frames == count
            assert film.info["loop"] == 0
            for k in range(count):
                film.seek(k)
                frames.append(np.asarray(film.convert("RGB")).astype(int))
        assert all(np.any(a != b) for a, b in itertools.pairwise(frames))


@pytest.mark.skipif(
    importlib.util.find_spec("imageio_ffmpeg") is not None, reason="an MP4 can be written here"
)
@pytest.mark.slow
@pytest.mark.usefixtures("can_draw")
def test_an_mp4_without_its_writer_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"imageio-ffmpeg.*\.gif"):
        view.animate([surface_file(tmp_path / "x.vti")], tmp_path / "x.mp4", size=(100, 50))
    assert os.listdir(tmp_path) == ["x.vti"]


@pytest.mark.slow
@pytest.mark.usefixtures("can_draw")
def test_what_a_worker_finds_wrong_comes_back_as_its_sentence(tmp_path: Path) -> None:
    write_image(tmp_path / "x.vti", {"gap": np.ones((4, 4))}, (1.0, 1.0), {})
    with pytest.raises(OutputError, match="holds no field pressure, only gap"):
        view.screenshot(tmp_path / "x.vti", tmp_path / "x.png")
    (tmp_path / "x.vtu").write_text("nothing")
    with pytest.raises(OutputError, match="is damaged or holds no cells"):
        view.screenshot(tmp_path / "x.vtu", tmp_path / "x.png")
    pv.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid().save(tmp_path / "y.vtu")
    with pytest.raises(OutputError, match="holds neither von Mises stress nor plastic strain"):
        view.screenshot(tmp_path / "y.vtu", tmp_path / "x.png")
    assert sorted(os.listdir(tmp_path)) == ["x.vti", "x.vtu", "y.vtu"]


def test_a_line_is_drawn_without_vtk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view.subprocess, "run", lambda *_: pytest.fail("VTK was asked"))
    pressure = np.maximum(np.sin(np.arange(50) / 5), 0)
    state = (pressure > 0) + (pressure > 0.8)
    fields: dict[str, Any] = {"pressure": pressure, "gap": 1 - pressure, "state": state}
    write_image(tmp_path / "x.vti", fields, (1e-6,), {})
    view.screenshot(tmp_path / "x.vti", tmp_path / "x.png")
    assert amount(pixels(tmp_path / "x.png"), BLACK) > 50
    write_image(tmp_path / "y.vti", {"gap": pressure}, (1e-6,), {})
    with pytest.raises(OutputError, match="holds no field called pressure, state"):
        view.screenshot(tmp_path / "y.vti", tmp_path / "y.png")


@pytest.fixture
def broken_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Puts a script of ours in the place of the worker's interpreter."""

    def replace(script: str) -> None:
        program = tmp_path / "python"
        program.write_text("#!/bin/sh\n" + script)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setattr(view.sys, "executable", str(program))

    return replace


@pytest.mark.skipif(os.name == "nt", reason="needs a shell")
@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("kill -SEGV $$", r"VTK crashed \(SIGSEGV\)"),
        (
            "echo noise; echo 'libGL missing' >&2; exit 3",
            "the drawing process failed: libGL missing",
        ),
        ("echo 'epcontact: the picture is blank'; exit 1", "the picture is blank"),
        ("exec sleep 60", "VTK did not draw anything within"),
        (None, "no process could be started"),
    ],
)
def test_where_nothing_can_be_drawn(
    script: str | None,
    words: str,
    tmp_path: Path,
    broken_python: Any,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The user gets one sentence, the terminal nothing, the folder nothing."""
    monkeypatch.setattr(view, "PATIENCE", 20.0 if "exec" not in (script or "") else 0.2)
    broken_python(script or "")
    if script is None:
        (tmp_path / "python").unlink()
    source = surface_file(tmp_path / "x.vti")
    with pytest.raises(
        OutputError, match=f"pictures cannot be drawn on this machine: {words}"
    ) as error:
        view.screenshot(source, tmp_path / "x.png")
    assert "\n" not in str(error.value)
    assert not [name for name in os.listdir(tmp_path) if name not in ("x.vti", "python")]
    assert capfd.readouterr() == ("", "")


def test_no_window_without_a_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OutputError, match="without a display; ask for a screenshot"):
        view.show(surface_file(tmp_path / "x.vti"))
    monkeypatch.setenv("DISPLAY", ":77")
    write_image(tmp_path / "line.vti", {"gap": np.ones(4)}, (1.0,), {})
    with pytest.raises(OutputError, match="is a line"):
        view.show(tmp_path / "line.vti")


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="displays are X's")
def test_no_window_on_a_display_that_does_not_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """VTK falls back to drawing where nobody sees it; nothing shown must not pass for shown."""
    monkeypatch.setenv("DISPLAY", ":7531")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(OutputError):
        view.show(surface_file(tmp_path / "x.vti"))


def test_what_is_no_result(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no such file"):
        view.screenshot(tmp_path / "gone.vti", tmp_path / "x.png")
    (tmp_path / "x.csv").write_text("")
    with pytest.raises(OutputError, match=r"a \.vti, \.vtu, \.pvd"):
        view.screenshot(tmp_path / "x.csv", tmp_path / "x.png")
    source = surface_file(tmp_path / "x.vti")
    with pytest.raises(OutputError, match=r"must be named \.png"):
        view.screenshot(source, tmp_path / "x.jpg")
    with pytest.raises(OutputError, match=r"must be named \.gif or \.mp4"):
        view.animate([source], tmp_path / "x.avi")
    with pytest.raises(OutputError, match="load steps"):
        view.animate([], tmp_path / "x.gif")
    write_image(tmp_path / "y.vti", {"pressure": np.ones((4, 5))}, (1.0, 1.0), {})
    with pytest.raises(OutputError, match="cannot compare"):
        view.compare(source, tmp_path / "y.vti", tmp_path / "x.png")


def test_fields_are_found_beside_a_method_s_json(tmp_path: Path) -> None:
    (tmp_path / "bem.json").write_text("{}")
    with pytest.raises(OutputError, match="no fields lie beside"):
        view.find_result(tmp_path / "bem.json")
    for seed in (9, 8):
        surface_file(tmp_path / f"bem-seed{seed}.vti")
    assert view.find_result(tmp_path / "bem.json").name == "bem-seed8.vti"
    surface_file(tmp_path / "bem.vti")
    assert view.find_result(tmp_path / "bem.json").name == "bem.vti"


@pytest.mark.skipif(os.name == "nt", reason="needs a shell")
def test_another_way_of_drawing_is_tried_where_one_fails(
    tmp_path: Path, broken_python: Any
) -> None:
    broken_python('test "$VTK_DEFAULT_OPENGL_WINDOW" = vtkOSOpenGLRenderWindow || kill -SEGV $$')
    view.screenshot(surface_file(tmp_path / "x.vti"), tmp_path / "x.png")


def test_the_steps_of_a_collection_are_read_in_order(tmp_path: Path) -> None:
    steps = {1 / (k + 1): tmp_path / f"{k}.vtu" for k in range(3)}
    path = collection_file(tmp_path / "x.pvd", steps)
    assert view.load_steps(path) == list(steps.values())[::-1]
    for content in ("", "<a/>", "<VTKFile><Collection><DataSet/></Collection></VTKFile>"):
        (tmp_path / "bad.pvd").write_text(content)
        with pytest.raises(OutputError, match="cannot read"):
            view.load_steps(tmp_path / "bad.pvd")
    with pytest.raises(OutputError, match="no such file"):
        view.load_steps(tmp_path / "gone.pvd")


@pytest.mark.parametrize(
    ("value", "rounded"),
    [(1.99, 1), (0.8, 1), (2, 2), (4.99, 2), (5, 5), (37, 20), (0.06, 0.05), (1000, 1000)],
)
def test_factors_are_round(value: float, rounded: float) -> None:
    assert round_factor(value) == pytest.approx(rounded)
    assert round_factor(float("nan")) == round_factor(0.0) == 1
