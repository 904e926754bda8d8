"""Drawing of result files by pyvista: surfaces in contact, cut blocks.

A .vti is drawn as the surface under the rigid flat, a .vtu as a finite-element block
that is cut open.  The fields of a block are recognised by words in their names, because
finite-element programs differ: a vector `displacement` (or `u`) at the points, a scalar
with `mises` in its name (Pa), and a scalar with both `plastic` and `strain` in its
name, at points or cells.  The coordinates are those of the undeformed body.

Only `view` imports this module, when it draws, because importing pyvista takes a
second.
"""

from __future__ import annotations

import ctypes.util
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from PIL import Image

from epcontact.errors import OutputError
from epcontact.output.charts import style
from epcontact.output.charts.style import STATE_NAMES, unit_for
from epcontact.output.vtk import FieldFile, read_fields, read_quietly
from epcontact.results import ELASTIC, PLASTIC

#: Largest number of points along a drawn surface; finer grids are drawn with a stride.
POINTS = 900
#: Drawn depth of the valleys as a share of the period, if no factor is given.
RELIEF = 0.08
#: Largest drawn displacement of a block as a share of its width, if no factor is given.
SHOWN = 0.04
#: Largest number of faces of a block with drawn element edges; more edges would blacken
#: it.
EDGES = 20_000
TEXT = {"color": "black", "font": "arial", "font_size": 11}

Limits = tuple[float, ...]


def draw(
    sources: Sequence[Path], size: tuple[int, int] | None, factor: float | None
) -> list[Image.Image]:
    """Draw each file as a picture, in one scale; without a size, show the file in a
    window.
    """
    surfaces = sources[0].suffix == ".vti"
    # A single file is read once; a film reads each file twice, to hold one at a time.
    read = functools.lru_cache(maxsize=1)(read_fields if surfaces else read_block)
    scale, paint = (
        (surface_scale, draw_surface) if surfaces else (block_scale, draw_block)
    )
    frames = []
    with pv.vtk_verbosity("off"):  # of the ways to draw that VTK tries in vain
        scales = [scale(read(source)) for source in sources]
        usual = min(each for each, _ in scales)
        chosen = usual if factor is None else factor
        if not 0 < chosen <= 1000 * usual:  # nor that of NaN
            raise OutputError(
                f"the factor must be positive and here at most {1000 * usual:g}"
            )
        limits = tuple(np.max([each for _, each in scales], axis=0).tolist())
        for source in sources:
            plotter = _plotter(size)
            paint(plotter, read(source), chosen, limits)
            if size is None:
                plotter.link_views()
                plotter.show(title="epcontact")
                continue
            frame = np.asarray(plotter.screenshot(None, return_img=True))
            plotter.close()
            if np.ptp(frame) == 0:
                raise OutputError(
                    "VTK draws on this machine, but its pictures are blank"
                )
            frames.append(Image.fromarray(frame))
    return frames


def _plotter(size: tuple[int, int] | None) -> Any:
    """Make a white window with two panels, off the screen if it has a size."""
    plotter = pv.Plotter(
        off_screen=size is not None, window_size=size, shape=(1, 2), border=False
    )
    plotter.set_background("white", all_renderers=True)
    kind = plotter.render_window.GetClassName()
    # VTK would crash where its last resort is not installed.
    if kind == "vtkOSOpenGLRenderWindow" and not ctypes.util.find_library("OSMesa"):
        raise OutputError(
            "VTK can draw no pictures here: it finds no display, EGL or OSMesa"
        )
    if size is None and kind in ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"):
        raise OutputError(
            "no window can be opened without a display; ask for a screenshot instead"
        )
    return plotter


def round_factor(shown: float, length: float) -> float:
    """Round shown/length down to 1, 2 or 5 times a power of ten; between 0.7 and 2
    return 1.
    """
    value = shown / length if length > 0 else 1.0
    if not 0 < value < np.inf or 0.7 <= value < 2:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-12)))


def surface_scale(file: FieldFile) -> tuple[float, Limits]:
    """Return a factor that shows typical valleys, and the upper end of the pressure
    scale.
    """
    depth = float(np.quantile(file.field("gap")[::4], 0.98))
    top = (
        file.hardness
        if np.isfinite(file.hardness)
        else float(file.field("pressure").max())
    )
    return round_factor(RELIEF * max(file.periods), depth), (top or 1.0,)


def draw_surface(plotter: Any, file: FieldFile, factor: float, limits: Limits) -> None:
    """Draw the contact state and the pressure on the deformed surface, under the flat
    at z = 0.
    """
    scale, unit = unit_for(max(file.periods), "m")
    top_scale, top_unit = unit_for(limits[0], "Pa")
    mesh = _surface(file, factor, scale, top_scale)
    states = file.field("state")
    keys = [
        (
            f"{STATE_NAMES[kind]} {100 * np.mean(states == kind):.2f} %",
            style.STATE_COLOURS[kind],
        )
        for kind in (ELASTIC, PLASTIC)
    ]
    mean = float(np.mean(file.field("pressure"), dtype=np.float64)) / top_scale
    state: dict[str, Any] = {
        "cmap": list(style.STATE_COLOURS.values()),
        "clim": (-0.5, 2.5),
        # The colours are interpolated, not the states: otherwise an elastic rim would
        # appear between apart and plastic.
        "interpolate_before_map": False,
        "show_scalar_bar": False,
    }
    pressure: dict[str, Any] = {
        "cmap": style.PRESSURE_MAP,
        "clim": (0.0, limits[0] / top_scale),
        "nan_color": "white",
        "scalar_bar_args": _bar(f"pressure ({top_unit}), white: none"),
    }
    sides = " × ".join(f"{length / scale:.4g}" for length in file.periods)
    titles = {
        "state": f"Contact (shares of grid points): {sides} {unit}, heights × {factor:.3g}",
        "pressure": f"Contact pressure, mean {mean:.4g} {top_unit}",
    }
    shading = {
        "smooth_shading": True,
        "ambient": 0.45,
        "diffuse": 0.55,
        "specular": 0.0,
    }
    for column, (name, look) in enumerate((("state", state), ("pressure", pressure))):
        plotter.subplot(0, column)
        plotter.add_mesh(mesh.copy(), scalars=name, **look, **shading)
        plotter.add_text(titles[name], **TEXT)
        _look_down(plotter, mesh)
        _mark_lengths(plotter, mesh.bounds, unit, "xy")
    plotter.subplot(0, 0)
    plotter.add_legend(
        keys, face="rectangle", loc="lower center", size=(0.22, 0.075), bcolor=None
    )


def _surface(file: FieldFile, factor: float, scale: float, top_scale: float) -> Any:
    """Return the deformed surface with state and pressure, lengths and pressures over
    scales.
    """
    step = max(1, -(-max(file.shape) // POINTS))
    gap, state, pressure = (
        np.asarray(file.field(name)[::step, ::step], dtype=kind)
        for name, kind in (
            ("gap", np.float64),
            ("state", np.intp),
            ("pressure", np.float64),
        )
    )
    axes = [
        np.append(np.arange(n) * (d * step), period)
        / scale  # the first points follow once more
        for n, d, period in zip(gap.shape, file.spacing, file.periods, strict=True)
    ]
    gap, state, pressure = (
        np.pad(field, (0, 1), mode="wrap") for field in (gap, state, pressure)
    )
    # Points in contact touch the flat, also where flow has cut off the peaks.
    height = -np.maximum(gap, 0.0) / scale
    mesh = pv.StructuredGrid(*np.meshgrid(*axes, indexing="ij"), height * factor)
    mesh["state"] = state.ravel(order="F")
    # Points without contact are NaN, not zero, so that they are white.
    mesh["pressure"] = np.where(pressure > 0, pressure / top_scale, np.nan).ravel(
        order="F"
    )
    return mesh


def _look_down(plotter: Any, mesh: Any) -> None:
    """Draw the frame of the rigid flat, with camera and light above the near corner."""
    x0, x1, y0, y1, *_ = mesh.bounds
    corners = np.array(
        [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0], [x0, y0, 0]]
    )
    plotter.add_mesh(pv.lines_from_points(corners), color="#555555", line_width=2)
    # The longer side of an oblong is drawn as long as a square's, so that its labels
    # have room.
    zoom = 0.9 * float(np.hypot(x1 - x0, y1 - y0)) / (2**0.5 * max(x1 - x0, y1 - y0))
    _frame_view(plotter, mesh.bounds, (-0.3, -1.25, 1.5), zoom)
    plotter.camera.SetWindowCenter(0.0, -0.25)
    plotter.remove_all_lights()
    direction = np.array([-1.0, -0.5, 1.0])
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
    position = middle + 10 * max(x1 - x0, y1 - y0) * direction
    # At this intensity the flat contact shows its true colours.
    bright = float(np.linalg.norm(direction) / direction[2])
    look = {"position": tuple(position), "focal_point": tuple(middle), "light_type": 3}
    plotter.add_light(pv.Light(intensity=bright, **look))


def read_block(source: Path) -> Any:
    """Read the mesh of a .vtu that holds a stress or a strain."""
    if not source.is_file():
        raise OutputError(f"cannot read {source}: there is no such file")
    mesh = read_quietly(source, "vtkXMLUnstructuredGridReader")
    if mesh is None or not mesh.n_cells:
        raise OutputError(f"cannot show {source}: it is damaged or holds no cells")
    if not any(_field_names(mesh)[1:]):
        raise OutputError(
            f"cannot show {source}: it holds no von Mises stress or plastic strain, "
            "and no contact pressure"
        )
    return mesh


def _field_names(mesh: Any) -> tuple[str, str, str]:
    """Return the names of displacement, von Mises stress and plastic strain, of a
    surface those of its contact pressure and gap in their place; empty if absent.
    """
    points, names = mesh.point_data, [*mesh.point_data.keys(), *mesh.cell_data.keys()]
    top = {"contact_pressure", "gap"} <= {*points.keys()}
    moves = (n for n in names if n.lower() in ("displacement", "u") and n in points)
    return (
        next((n for n in moves if points[n].shape[1:] == (3,)), ""),
        next((n for n in names if "mises" in n.lower()), "contact_pressure" * top),
        next(
            (n for n in names if "plastic" in n.lower() and "strain" in n.lower()),
            "gap" * top,
        ),
    )


def block_scale(mesh: Any) -> tuple[float, Limits]:
    """Return a factor that shows the deformation, the largest stress (Pa) and plastic
    strain.
    """
    displacement, *shown = _field_names(mesh)
    fields = (
        mesh.get_array(name, preference="point") if name else 0.0 for name in shown
    )
    limits = tuple(float(np.max(field, initial=0.0)) for field in fields)
    largest = (
        float(np.abs(mesh.point_data[displacement]).max()) if displacement else 0.0
    )
    x0, x1, y0, y1, *_ = mesh.bounds
    return round_factor(SHOWN * max(x1 - x0, y1 - y0), largest), limits


def draw_block(plotter: Any, mesh: Any, factor: float, limits: Limits) -> None:
    """Draw von Mises stress and plastic strain on the block without its front
    quarter.
    """
    displacement, stress, strain = _field_names(mesh)
    x0, x1, y0, y1, *_ = mesh.bounds
    centres = np.asarray(mesh.cell_centers().points)
    # Whole elements are removed.  The shift keeps those on the cut despite rounding.
    x, y = (x0 + x1) / 2 - 1e-6 * (x1 - x0), (y0 + y1) / 2 - 1e-6 * (y1 - y0)
    flat = mesh.get_cell(0).dimension == 2
    behind = flat | (centres[:, 0] >= x) | (centres[:, 1] >= y)
    opened = mesh.extract_cells(np.flatnonzero(behind))
    scale, unit = unit_for(
        float(np.ptp(np.reshape(mesh.bounds, (3, 2)), axis=1).max()), "m"
    )
    # The axes are those of the body at rest, as its coordinates are.
    rest = [end / scale for end in mesh.bounds]
    if displacement:
        opened = opened.warp_by_vector(displacement, factor=factor)
    opened.points = np.asarray(opened.points, dtype=np.float64) / scale
    skin = opened.extract_surface(nonlinear_subdivision=1, algorithm="dataset_surface")
    stress_scale, stress_unit = unit_for(limits[0], "Pa")
    kind, of_gap, gap_unit = "von Mises stress", 1.0, "-"
    if strain == "gap":
        kind, (of_gap, gap_unit) = "contact pressure", unit_for(limits[1], "m")
    other = "equivalent plastic strain" if kind.startswith("von") else "gap"
    panels = (
        (stress, stress_scale, limits[0], f"{kind} ({stress_unit})", style.STRESS_MAP),
        (strain, of_gap, limits[1], f"{other} ({gap_unit})", "cividis"),
    )
    edges = {
        "show_edges": skin.n_cells <= EDGES,
        "edge_color": "#404040",
        "edge_opacity": 0.35,
    }
    shading = {"ambient": 0.5, "diffuse": 0.55, "specular": 0.0}
    for column, (name, divisor, top, title, colours) in enumerate(panels):
        plotter.subplot(0, column)
        if name:
            # Of a field that points and cells hold, that of the points is drawn.
            shown = skin.get_array(name, preference="point") / divisor
            look = {"clim": (0.0, top / divisor or 1.0), "cmap": colours}
            bar = {"scalar_bar_args": _bar(title)}
            plotter.add_mesh(
                skin.copy(), scalars=shown, **look, **bar, **edges, **shading
            )
        else:
            plotter.add_mesh(skin, color="#d9d9d9")
            plotter.add_text(f"no {title.partition(' (')[0]} in the file", **TEXT)
        _frame_view(plotter, opened.bounds, (-0.9, -1.3, 1.1), 0.8)
        plotter.camera.SetWindowCenter(0.0, -0.2)
        _mark_lengths(plotter, rest, unit, "xy" if flat else "xyz")
    shape = f"displacements × {factor:.3g}" if displacement else "undeformed"
    size = " × ".join(
        f"{length:.4g}" for length in np.ptp(np.reshape(rest, (3, 2)), axis=1)
    )
    plotter.subplot(0, 0)
    plotter.add_text(f"{size} {unit}, {shape}", **TEXT)


def _bar(title: str) -> dict[str, Any]:
    """Return the settings of a colour bar below the picture."""
    place = {"width": 0.5, "height": 0.07, "position_x": 0.25, "position_y": 0.02}
    text = {
        "color": "black",
        "fmt": "%.3g",
        "title_font_size": 18,
        "label_font_size": 15,
    }
    return {"title": title + "\n", "n_labels": 4, **place, **text}


def _mark_lengths(plotter: Any, bounds: Any, unit: str, axes: str) -> None:
    """Draw axes with ticks along the outer edges; stretched heights have no axis."""
    largest = float(np.max(np.abs(bounds)))
    unit = unit.replace("µm", "micrometres")  # VTK's font for axes has no µ
    shown = {
        f"show_{axis}{what}": axis in axes
        for axis in "xyz"
        for what in ("axis", "labels")
    }
    # Not an empty title, of which VTK would complain.
    titles = {
        f"{axis}title": f"{axis} ({unit})" if axis in axes else " " for axis in "xyz"
    }
    labels = {f"n_{axis}labels": 3 for axis in "xyz"} | {"fmt": "%.3g", "font_size": 11}
    ends = [round(end / largest, 3) * largest + 0.0 for end in bounds]
    look = (
        {"location": "outer", "ticks": "outside", "color": "#303030"}
        | shown
        | titles
        | labels
    )
    drawn = plotter.show_bounds(bounds=bounds, axes_ranges=ends, **look)
    drawn.SetEnableDistanceLOD(False)  # which hides the labels of the far end


def _frame_view(
    plotter: Any, bounds: Any, towards: Sequence[float], zoom: float
) -> None:
    """Look at the middle of `bounds` from the direction `towards`, with room for a bar
    below.
    """
    middle = (np.asarray(bounds[0::2]) + np.asarray(bounds[1::2])) / 2
    plotter.camera_position = [
        tuple(middle + np.asarray(towards)),
        tuple(middle),
        (0, 0, 1),
    ]
    plotter.reset_camera(bounds=bounds)
    plotter.camera.zoom(zoom)
    plotter.camera.SetWindowCenter(0.0, -0.1)
