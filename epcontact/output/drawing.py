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
from typing import Any, NamedTuple

import numpy as np
import pyvista as pv
from PIL import Image

from epcontact.errors import OutputError
from epcontact.output.charts import style
from epcontact.output.charts.maps import flattened_depth, visible_state
from epcontact.output.charts.style import STATE_NAMES, unit_for
from epcontact.output.vtk import FieldFile, read_fields, read_quietly
from epcontact.results import APART, PLASTIC

#: Largest number of points along a drawn surface; finer grids are drawn with a stride.
POINTS = 900
#: Drawn depth of the valleys over the period, if no factor is given.
_RELIEF = 0.08
#: Largest drawn displacement of a block over its width, if no factor is given.
_DEFORMATION = 0.04
#: A factor must be at most so many times that which is taken if none is given.
_LARGEST_FACTOR = 1000
#: Largest number of faces of a block with drawn element edges; more edges would blacken
#: it.
EDGES = 20_000
TEXT = {"color": "black", "font": "arial", "font_size": 14}
#: Colour of points without contact.  White slopes would be as bright as the paper.
_GREY = "#c9c9c9"
#: Left end and width of the bar of contact states, as fractions of the panel.
_STATES_LEFT = 0.1
_STATES_WIDTH = 0.8
#: The quantile of the gap that stands for the depth of typical valleys.
_TYPICAL_DEPTH = 0.98

#: Ends of the colour scales: the pressure (Pa) of a surface; the stress (Pa), or the
#: pressure, and the strain, or the gap (m), of a block.
Limits = tuple[float, ...]


def draw(
    sources: Sequence[Path], size: tuple[int, int] | None, factor: float | None
) -> list[Image.Image]:
    """Draw each file as a picture, in one scale; without a size, show it in a window.

    Args:
        sources: files of one kind, .vti or .vtu.
        size: width and height of the pictures in pixels; None: a window.
        factor: stretches the heights or displacements; None: by a round number that
            makes those of all files visible.

    Returns:
        A picture for each file; none if they were shown in windows.

    Raises:
        OutputError: if a file cannot be read, if the factor is not positive or far too
            large, or if VTK cannot draw on this machine.
    """
    functions: tuple[Any, Any, Any] = (read_block, block_scale, draw_block)
    if sources[0].suffix == ".vti":
        functions = (read_fields, surface_scale, draw_surface)
    read_file, scale_of, paint = functions
    # A single file is read once; a film reads each file twice, to hold one at a time.
    read = functools.lru_cache(maxsize=1)(read_file)
    frames = []
    with pv.vtk_verbosity("off"):  # of the ways to draw that VTK tries in vain
        scales = [scale_of(read(source)) for source in sources]
        usual_factor = min(each for each, _ in scales)
        if factor is None:
            factor = usual_factor
        largest_factor = _LARGEST_FACTOR * usual_factor
        if not 0 < factor <= largest_factor:  # nor NaN
            raise OutputError(
                f"the factor must be positive and here at most {largest_factor:g}"
            )
        limits = tuple(np.max([each for _, each in scales], axis=0).tolist())
        for source in sources:
            plotter = _plotter(size)
            paint(plotter, read(source), factor, limits)
            if size is None:
                plotter.link_views()
                plotter.show(title="epcontact")
            else:
                frames.append(_picture(plotter))
    return frames


def _plotter(size: tuple[int, int] | None) -> Any:
    """Return an empty white window of pyvista with two panels side by side.

    Args:
        size: width and height in pixels of a picture that is drawn off the screen;
            None: a window on the screen.

    Raises:
        OutputError: if VTK cannot draw on this machine, or if a window is asked for and
            there is no display.
    """
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


def _picture(plotter: Any) -> Image.Image:
    """Return what was drawn off the screen as an image, and close the window.

    Args:
        plotter: the window of pyvista.

    Raises:
        OutputError: if all pixels are equal, because VTK has drawn nothing.
    """
    pixels = np.asarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    if np.ptp(pixels) == 0:
        raise OutputError("VTK draws on this machine, but its pictures are blank")
    return Image.fromarray(pixels)


def round_factor(drawn: float, length: float) -> float:
    """Return a round number by which a length is stretched in a picture.

    Args:
        drawn: the length that would be well visible.
        length: the true length in the same unit.

    Returns:
        drawn / length rounded down to 1, 2 or 5 times a power of ten; 1 if the quotient
        is between 0.7 and 2, infinite or no number.
    """
    factor = 1.0
    if length > 0:
        factor = drawn / length
    if not 0 < factor < np.inf or 0.7 <= factor < 2:
        return 1.0
    power = 10.0 ** np.floor(np.log10(factor))
    digits = [digit for digit in (1, 2, 5) if digit * power <= factor * (1 + 1e-12)]
    return float(power * max(digits))


# --- surfaces
# ---------------------------------------------------------------------------


def surface_scale(file: FieldFile) -> tuple[float, Limits]:
    """Return how a surface in contact is drawn if the user does not say it.

    Args:
        file: the fields of the surface, with gap (m) and pressure (Pa).

    Returns:
        The dimensionless factor that stretches heights so that typical valleys are
        visible, and a tuple with the pressure (Pa) at which the colour scale ends: the
        hardness, or the largest pressure of a body without hardness.

    Raises:
        OutputError: if the file lacks one of the two fields.
    """
    depth = float(np.quantile(file.field("gap")[::4], _TYPICAL_DEPTH))
    largest = file.hardness
    if not np.isfinite(largest):
        largest = float(file.field("pressure").max())
    return round_factor(_RELIEF * max(file.periods), depth), (largest or 1.0,)


def draw_surface(plotter: Any, file: FieldFile, factor: float, limits: Limits) -> None:
    """Draw contact state and pressure on the deformed surface, side by side.

    The rigid flat is at z = 0, above the surface.

    Args:
        plotter: the window of pyvista.
        file: the fields of the surface: state, pressure (Pa) and gap (m).
        factor: the dimensionless number by which heights are stretched.
        limits: one number, the pressure (Pa) at which the colour scale ends.
    """
    scale, unit = unit_for(max(file.periods), "m")
    right = _right_panel(file, limits)
    mesh = _surface_mesh(file, factor, scale, right)
    states = visible_state(file.fields)
    kinds = range(int(states.max(initial=PLASTIC)) + 1)
    colours = style.STATE_COLOURS | {APART: _GREY}
    state_look: dict[str, Any] = {
        "cmap": [colours[kind] for kind in kinds],
        "clim": (-0.5, len(kinds) - 0.5),
        "scalar_bar_args": _colour_bar("")
        | {"n_labels": 0, "width": _STATES_WIDTH, "position_x": _STATES_LEFT},
        # The colours are interpolated, not the states: otherwise an elastic rim would
        # appear between apart and plastic.
        "interpolate_before_map": False,
    }
    right_look: dict[str, Any] = {
        "cmap": style.PRESSURE_MAP,
        "clim": (0.0, right.largest / right.scale),
        "nan_color": _GREY,
        "scalar_bar_args": _colour_bar(f"{right.label} ({right.unit}), grey: none"),
    }
    sides = " × ".join(f"{length / scale:.4g}" for length in file.periods)
    mean = float(np.mean(file.field("pressure"), dtype=np.float64))
    mean_scale, mean_unit = unit_for(mean, "Pa")
    state_title = f"Contact state; {sides} {unit}, heights × {factor:.3g}"
    load = f"mean pressure {mean / mean_scale:.4g} {mean_unit}"
    right_title = f"{right.label.capitalize()}; {load}"
    shading = {
        "smooth_shading": True,
        "ambient": 0.45,
        "diffuse": 0.55,
        "specular": 0.0,
    }
    panels = (
        ("state", state_look, state_title),
        (right.field, right_look, right_title),
    )
    for column, (name, look, title) in enumerate(panels):
        plotter.subplot(0, column)
        plotter.add_mesh(mesh.copy(), scalars=name, **look, **shading)
        plotter.add_text(title, **TEXT)
        _look_down(plotter, mesh)
        _mark_lengths(plotter, mesh.bounds, unit, "xy")
    plotter.subplot(0, 0)
    for number, kind in enumerate(kinds):
        percentage = 100 * np.mean(states == kind)
        middle = _STATES_LEFT + _STATES_WIDTH * (number + 0.5) / len(kinds)
        text = plotter.add_text(
            f"{STATE_NAMES[kind]}\n{percentage:.2f} %",
            position=(middle, 0.06),
            viewport=True,
            **TEXT | {"font_size": 10},
        )
        text.prop.justification_horizontal = "center"


class _RightPanel(NamedTuple):
    """What the right panel of a surface shows.

    Attributes:
        field: the name of the field in the file.
        label: what the field is, in words.
        largest: the value at which the colour scale ends, in the SI unit of the field.
        scale, unit: values are divided by this number, and then have this unit.
    """

    field: str
    label: str
    largest: float
    scale: float
    unit: str


def _right_panel(file: FieldFile, limits: Limits) -> _RightPanel:
    """Return what the right panel of a surface shows.

    It is the contact pressure, or the plastic displacement if no point has a pressure,
    which is so at the end of a path that ends at no load.

    Args:
        file: the fields of the surface.
        limits: one number, the pressure (Pa) at which the colour scale ends.
    """
    depth = flattened_depth(file.fields)
    if np.any(file.field("pressure") > 0) or depth is None or not np.any(depth > 0):
        return _RightPanel(
            "pressure", "contact pressure", limits[0], *unit_for(limits[0], "Pa")
        )
    name = "plastic_displacement"
    deepest = float(np.max(depth))
    return _RightPanel(name, name.replace("_", " "), deepest, *unit_for(deepest, "m"))


def _surface_mesh(
    file: FieldFile, factor: float, scale: float, right: _RightPanel
) -> Any:
    """Return the deformed surface as a mesh of pyvista with the fields of both panels.

    Args:
        file: the fields of the surface: state, pressure (Pa) and gap (m).
        factor: the dimensionless number by which heights are stretched.
        scale: lengths are divided by this number (m).
        right: the field of the right panel.
    """
    fields = dict(file.fields)
    depth = flattened_depth(fields)
    if depth is not None:
        # The gap is that to the surface before it flowed.
        fields["gap"] = file.field("gap") + depth
    fields["state"] = visible_state(fields)
    stride = max(1, -(-max(file.shape) // POINTS))

    def drawn(name: str, kind: type) -> np.ndarray:
        """Return a field [x, y] at the points that are drawn.

        The first row and the first column follow once more after the last ones.

        Args:
            name: the name of the field.
            kind: the type of the numbers, such as np.float64.
        """
        field: np.ndarray = np.asarray(fields[name][::stride, ::stride], dtype=kind)
        return np.pad(field, (0, 1), mode="wrap")

    gap = drawn("gap", np.float64)
    shown = drawn(right.field, np.float64)
    axes = []
    for count, distance, period in zip(
        gap.shape, file.spacing, file.periods, strict=True
    ):
        points = np.arange(count - 1) * (distance * stride)
        axes.append(np.append(points, period) / scale)
    # Points in contact touch the flat, also where flow has cut off the peaks.
    height = -np.maximum(gap, 0.0) / scale
    mesh = pv.StructuredGrid(*np.meshgrid(*axes, indexing="ij"), height * factor)
    mesh["state"] = drawn("state", np.intp).ravel(order="F")
    # Points without contact are NaN, not zero, so that they are white.
    scaled = np.where(shown > 0, shown / right.scale, np.nan)
    mesh[right.field] = scaled.ravel(order="F")
    return mesh


def _look_down(plotter: Any, mesh: Any) -> None:
    """Draw the edges of the rigid flat, and set camera and light above a near corner.

    Args:
        plotter: the window of pyvista, whose active panel is changed.
        mesh: the surface, in the unit of the drawing; the flat is at z = 0 over it.
    """
    x0, x1, y0, y1, *_ = mesh.bounds
    corners = [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0], [x0, y0, 0]]
    frame = pv.lines_from_points(np.array(corners))
    plotter.add_mesh(frame, color="#555555", line_width=2)
    longer_side = max(x1 - x0, y1 - y0)
    # The longer side of an oblong is drawn as long as a square's, so that its labels
    # have room.
    zoom = 0.98 * float(np.hypot(x1 - x0, y1 - y0)) / (2**0.5 * longer_side)
    _frame_view(plotter, mesh.bounds, (-0.25, -0.9, 1.7), zoom)
    plotter.camera.SetWindowCenter(0.0, -0.2)
    plotter.remove_all_lights()
    direction = np.array([-1.0, -0.5, 1.0])
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
    position = middle + 10 * longer_side * direction
    light = pv.Light(
        position=tuple(position),
        focal_point=tuple(middle),
        light_type=3,
        # At this intensity the flat contact shows its true colours.
        intensity=float(np.linalg.norm(direction) / direction[2]),
    )
    plotter.add_light(light)


# --- blocks
# ---------------------------------------------------------------------------


def read_block(source: Path) -> Any:
    """Return the mesh of a .vtu file as a data set of pyvista.

    Raises:
        OutputError: if the file cannot be read, is damaged, or holds neither stress nor
            strain.
    """
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
    """Return the names of the three fields of a mesh that are drawn.

    Args:
        mesh: a data set of pyvista with fields at points or cells.

    Returns:
        The names of displacement, von Mises stress and plastic strain.  For a mesh with
        the fields "contact_pressure" and "gap" but without stress and strain, these two
        are the second and the third.  A name is "" if the mesh has no such field.
    """
    displacement, stress, strain = "", "", ""
    points = mesh.point_data
    if "contact_pressure" in points and "gap" in points:
        stress, strain = "contact_pressure", "gap"
    # The first field of each kind counts.
    for name in reversed([*points.keys(), *mesh.cell_data.keys()]):
        word = name.lower()
        is_vector = name in points and points[name].shape[1:] == (3,)
        if word in ("displacement", "u") and is_vector:
            displacement = name
        if "mises" in word:
            stress = name
        if "plastic" in word and "strain" in word:
            strain = name
    return displacement, stress, strain


def block_scale(mesh: Any) -> tuple[float, Limits]:
    """Return how a finite-element block is drawn if the user does not say it.

    Args:
        mesh: the block, a data set of pyvista.

    Returns:
        The dimensionless factor that stretches displacements so that they are visible,
        and a tuple of the largest stress (Pa) and the largest plastic strain; for a
        surface mesh, of the largest contact pressure (Pa) and gap (m).  A maximum is 0
        if the mesh has no such field.
    """
    displacement, *scalars = _field_names(mesh)
    limits = []
    for name in scalars:
        largest = 0.0
        if name:
            values = mesh.get_array(name, preference="point")
            largest = float(np.max(values, initial=0.0))
        limits.append(largest)
    moved = 0.0
    if displacement:
        moved = float(np.abs(mesh.point_data[displacement]).max())
    x0, x1, y0, y1, *_ = mesh.bounds
    return round_factor(_DEFORMATION * max(x1 - x0, y1 - y0), moved), tuple(limits)


def draw_block(plotter: Any, mesh: Any, factor: float, limits: Limits) -> None:
    """Draw von Mises stress and plastic strain on a block without its front quarter.

    Args:
        plotter: the window of pyvista.
        mesh: the block, a data set of pyvista; a mesh of faces is drawn without a cut.
        factor: the dimensionless number by which displacements are stretched.
        limits: the stress (Pa) and the strain at which the colour scales end; of a mesh
            with contact pressure and gap, the pressure (Pa) and the gap (m).
    """
    displacement, stress, strain = _field_names(mesh)
    stress_title, strain_title = "von Mises stress", "equivalent plastic strain"
    stress_scale, stress_unit = unit_for(limits[0], "Pa")
    strain_scale = 1.0
    strain_unit = "-"
    if strain == "gap":
        stress_title, strain_title = "contact pressure", "gap"
        strain_scale, strain_unit = unit_for(limits[1], "m")
    panels = (
        (stress, stress_title, stress_scale, stress_unit, style.STRESS_MAP),
        (strain, strain_title, strain_scale, strain_unit, "cividis"),
    )
    sides = np.ptp(np.reshape(mesh.bounds, (3, 2)), axis=1)
    scale, unit = unit_for(float(sides.max()), "m")
    # The axes are those of the body at rest, as its coordinates are.
    bounds_at_rest = [end / scale for end in mesh.bounds]
    axes = "xyz"
    opened = mesh.extract_cells(_cells_behind_cut(mesh))
    if mesh.get_cell(0).dimension == 2:
        axes = "xy"
        opened = mesh.copy()
    if displacement:
        opened = opened.warp_by_vector(displacement, factor=factor)
    opened.points = np.asarray(opened.points, dtype=np.float64) / scale
    skin = opened.extract_surface(nonlinear_subdivision=1, algorithm="dataset_surface")
    edges = {
        "show_edges": skin.n_cells <= EDGES,
        "edge_color": "#404040",
        "edge_opacity": 0.35,
    }
    shading = {"ambient": 0.5, "diffuse": 0.55, "specular": 0.0}
    for column, (name, title, value_scale, value_unit, colours) in enumerate(panels):
        plotter.subplot(0, column)
        if name:
            # Of a field that points and cells hold, that of the points is drawn.
            values = skin.get_array(name, preference="point") / value_scale
            plotter.add_mesh(
                skin.copy(),
                scalars=values,
                clim=(0.0, limits[column] / value_scale or 1.0),
                cmap=colours,
                scalar_bar_args=_colour_bar(f"{title} ({value_unit})"),
                **edges,
                **shading,
            )
        else:
            plotter.add_mesh(skin, color="#d9d9d9")
            plotter.add_text(f"no {title} in the file", **TEXT)
        _frame_view(plotter, opened.bounds, (-0.9, -1.3, 1.1), 0.8)
        plotter.camera.SetWindowCenter(0.0, -0.2)
        _mark_lengths(plotter, bounds_at_rest, unit, axes)
    shape = "undeformed"
    if displacement:
        shape = f"displacements × {factor:.3g}"
    size = " × ".join(f"{side / scale:.4g}" for side in sides)
    plotter.subplot(0, 0)
    plotter.add_text(f"{size} {unit}, {shape}", **TEXT)


def _cells_behind_cut(mesh: Any) -> np.ndarray:
    """Return the indices of the cells of a block that remain after the cut.

    The cut removes the quarter in front: the cells whose centres are below the middle
    of the block along both x and y.

    Args:
        mesh: the block, a data set of pyvista.
    """
    x0, x1, y0, y1, *_ = mesh.bounds
    centres = np.asarray(mesh.cell_centers().points)
    # The shift keeps whole elements on the cut despite rounding.
    x = (x0 + x1) / 2 - 1e-6 * (x1 - x0)
    y = (y0 + y1) / 2 - 1e-6 * (y1 - y0)
    return np.flatnonzero((centres[:, 0] >= x) | (centres[:, 1] >= y))


# --- both
# ---------------------------------------------------------------------------


def _colour_bar(title: str) -> dict[str, Any]:
    """Return the settings of a colour bar at the lower edge of a panel.

    Args:
        title: the title of the bar: quantity and unit.

    Returns:
        Keywords of pyvista's `Plotter.add_scalar_bar`; lengths are fractions of the
        panel and font sizes are in points.
    """
    return {
        "title": f"{title}\n",
        "n_labels": 4,
        "width": 0.5,
        "height": 0.07,
        "position_x": 0.25,
        "position_y": 0.02,
        "color": "black",
        "fmt": "%.3g",
        "title_font_size": 18,
        "label_font_size": 15,
    }


def _mark_lengths(plotter: Any, bounds: Any, unit: str, axes: str) -> None:
    """Draw axes with ticks along the outer edges.

    Args:
        plotter: the window of pyvista.
        bounds: the bounds of the body (x, x, y, y, z, z), in the unit.
        unit: the unit of lengths, such as "mm", for the titles of the axes.
        axes: the axes that are drawn, such as "xy"; stretched heights have no axis.
    """
    unit = unit.replace("µm", "micrometres")  # VTK's font for axes has no µ
    look: dict[str, Any] = {"location": "outer", "ticks": "outside"}
    look |= {"color": "#303030", "fmt": "%.3g", "font_size": 16}
    for axis in "xyz":
        look[f"show_{axis}axis"] = axis in axes
        look[f"show_{axis}labels"] = axis in axes
        look[f"n_{axis}labels"] = 3
        # Not an empty title, of which VTK would complain.
        look[f"{axis}title"] = f"{axis} ({unit})" if axis in axes else " "
    largest = float(np.max(np.abs(bounds)))
    ends = [round(end / largest, 3) * largest + 0.0 for end in bounds]
    drawn = plotter.show_bounds(bounds=bounds, axes_ranges=ends, **look)
    drawn.SetEnableDistanceLOD(False)  # which hides the labels of the far end


def _frame_view(
    plotter: Any, bounds: Any, towards: Sequence[float], zoom: float
) -> None:
    """Point the camera at the middle of a body, with room for a colour bar below.

    Args:
        plotter: the window of pyvista, whose active panel is changed.
        bounds: the bounds of the body (x, x, y, y, z, z), in the unit of the drawing.
        towards: the direction (x, y, z) from the middle of the body to the camera.
        zoom: a dimensionless factor; more than 1 shows the body larger.
    """
    middle = (np.asarray(bounds[0::2]) + np.asarray(bounds[1::2])) / 2
    position = tuple(middle + np.asarray(towards))
    plotter.camera_position = [position, tuple(middle), (0, 0, 1)]
    plotter.reset_camera(bounds=bounds)
    plotter.camera.zoom(zoom)
    plotter.camera.SetWindowCenter(0.0, -0.1)
