"""The worker that draws: run as a module, it reads one task from its standard input.

Only `epcontact.output.view.render` starts it.  It ends with 0, or prints one marked sentence
and ends with 1; anything else VTK may do to it stays in this process.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.output.charts.style import (
    DIFFERENCE_MAP,
    PRESSURE_MAP,
    STATE_COLOURS,
    STATE_NAMES,
    unit_for,
)
from epcontact.output.view.render import MARK
from epcontact.output.view.staging import bar, finish, frame_view, new_plotter, round_factor
from epcontact.output.vtk import FieldFile, read_fields
from epcontact.results import ELASTIC, PLASTIC

#: Points along the longer side of a drawn surface; finer grids are drawn with a stride.
POINTS = 900
#: Of the period, the depth of the valleys that is shown when no factor is given.
RELIEF = 0.08
GREY = "#555555"
#: Of the light's direction below; the flat contact then shows its colours as they are.
SHADING = {"smooth_shading": True, "ambient": 0.45, "diffuse": 0.55, "specular": 0.0}
LIGHT = (-1.0, -0.5, 1.0)
TEXT = {"color": "black", "font": "arial"}


def probe(_: dict[str, Any]) -> None:
    """Draw a white ball on black and look whether it is there."""
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=(48, 48))
    plotter.set_background("black")
    plotter.add_mesh(pv.Sphere(), color="white", lighting=False)
    image = np.asarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    if image.max() < 250 or image.min() > 5:
        raise OutputError("VTK draws, but the picture is blank")


def surface(task: dict[str, Any]) -> None:
    """The contact of one .vti; the picture, or a window where no picture is asked for."""
    plotter = new_plotter(task, (1, 2))
    read = read_fields(task["source"])
    _draw_surface(plotter, read, task["factor"] or _relief_factor([read]), _top_of([read]))
    finish(plotter, task)


def compare(task: dict[str, Any]) -> None:
    """Two pressures and their difference, from above."""
    plotter = new_plotter(task, (1, 3))
    files = [_strided(read_fields(source)) for source in task["sources"]]
    pressures = [np.asarray(_field(f, "pressure"), dtype=np.float64) for f in files]
    scale, unit = unit_for(max(float(p.max()) for p in pressures), "Pa")
    top = max(float(p.max()) for p in pressures) / scale
    for column, (name, pressure) in enumerate(zip(task["names"], pressures, strict=True)):
        plotter.subplot(0, column)
        _flat(plotter, files[0], pressure / scale, (0.0, top), PRESSURE_MAP, f"{name} ({unit})")
    difference = pressures[0] - pressures[1]
    most = float(np.abs(difference).max())
    scale, unit = unit_for(most, "Pa")
    plotter.subplot(0, 2)
    bound = most / scale or 1.0
    title = f"{task['names'][0]} minus {task['names'][1]} ({unit})"
    _flat(plotter, files[0], difference / scale, (-bound, bound), DIFFERENCE_MAP, title)
    finish(plotter, task)


def block(task: dict[str, Any]) -> None:
    """A finite-element block, cut open."""
    from epcontact.output.view.blocks import draw_block, read_block, shape_factor

    plotter = new_plotter(task, (1, 2))
    read = read_block(task["source"])
    draw_block(plotter, read, task["factor"] or shape_factor([read]), read.limits)
    finish(plotter, task)


def animate(task: dict[str, Any]) -> None:
    """Load steps as a film; one camera, one scale of colours and one factor for all frames."""
    from epcontact.output.view.blocks import draw_block, joint_limits, read_block, shape_factor
    from epcontact.output.view.films import write_film

    sources = task["sources"]
    draw: Callable[[Any, str], None]
    if task["kind"] == "surface":
        # Read twice rather than kept: a film of large grids must not need them all at once.
        factor = task["factor"] or min(_relief_factor([read_fields(s)]) for s in sources)
        top = max(_top_of([read_fields(s)]) for s in sources)

        def draw(plotter: Any, source: str) -> None:
            _draw_surface(plotter, read_fields(source), factor, top)
    else:
        factor = task["factor"] or min(shape_factor([read_block(s)]) for s in sources)
        limits = joint_limits([read_block(s).limits for s in sources])

        def draw(plotter: Any, source: str) -> None:
            draw_block(plotter, read_block(source), factor, limits)

    frames = []
    for source in sources:
        plotter = new_plotter({**task, "picture": "frame"}, (1, 2))
        draw(plotter, source)
        frames.append(np.asarray(plotter.screenshot(None, return_img=True)))
        plotter.close()
    write_film(Path(task["picture"]), frames, task["frames_per_second"])


def _draw_surface(plotter: Any, read: FieldFile, factor: float, top: float) -> None:
    import pyvista as pv

    small = _strided(read)
    gap, state = _field(small, "gap"), np.asarray(_field(small, "state"), dtype=np.intp)
    scale, unit = unit_for(max(read.periods), "m")
    # Under the flat at z = 0: contact touches it, also where the peaks were cut off by flow.
    height = -np.maximum(np.asarray(gap, dtype=np.float64), 0.0) / scale
    axes = [np.arange(n) * d / scale for n, d in zip(small.shape, small.spacing, strict=True)]
    x, y = np.meshgrid(*axes, indexing="ij")
    mesh = pv.StructuredGrid(x, y, height * factor)
    whole = _field(read, "state")
    shares = {kind: float(np.mean(whole == kind)) for kind in (ELASTIC, PLASTIC)}
    size = " × ".join(f"{p / scale:.4g}" for p in read.periods)
    plotter.subplot(0, 0)
    mesh["state"] = state.ravel(order="F")
    plotter.add_mesh(
        mesh,
        scalars="state",
        cmap=list(STATE_COLOURS.values()),
        clim=(-0.5, 2.5),
        # Colours are blended along an edge, never states: between apart and plastic lies no
        # elastic rim.
        interpolate_before_map=False,
        annotations={k: f"{STATE_NAMES[k]} {100 * share:.2f} %" for k, share in shares.items()},
        scalar_bar_args={
            **bar("contact state, white: apart"),
            "n_labels": 0,
            "position_y": 0.06,
        },
        **SHADING,
    )
    plotter.add_text(f"Contact: {size} {unit}, heights × {factor:.3g}", font_size=11, **TEXT)
    _look_down(plotter, mesh)
    plotter.subplot(0, 1)
    pressure_scale, pressure_unit = unit_for(top, "Pa")
    pressure = np.asarray(_field(small, "pressure"), dtype=np.float64) / pressure_scale
    other = mesh.copy()
    # Nothing (NaN) rather than zero where there is no contact: white, as in the scale's title.
    other["pressure"] = np.where(pressure > 0, pressure, np.nan).ravel(order="F")
    plotter.add_mesh(
        other,
        scalars="pressure",
        clim=(0.0, top / pressure_scale),
        cmap=PRESSURE_MAP,
        nan_color="white",
        **SHADING,
        scalar_bar_args=bar(f"pressure ({pressure_unit}), white: none"),
    )
    mean = float(np.mean(_field(read, "pressure"), dtype=np.float64)) / pressure_scale
    plotter.add_text(f"Contact pressure, mean {mean:.4g} {pressure_unit}", font_size=11, **TEXT)
    _look_down(plotter, other)


def _look_down(plotter: Any, mesh: Any) -> None:
    """The frame of the rigid flat and a view from above the near corner."""
    import pyvista as pv

    x0, x1, y0, y1, *_ = mesh.bounds
    corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0], [x0, y0, 0]])
    plotter.add_mesh(pv.lines_from_points(corners), color=GREY, line_width=2)
    frame_view(plotter, mesh.bounds, (-0.3, -1.25, 1.5), 1.04)
    plotter.remove_all_lights()
    middle, size = ((x0 + x1) / 2, (y0 + y1) / 2, 0.0), max(x1 - x0, y1 - y0)
    towards = tuple(m + 10 * size * d for m, d in zip(middle, LIGHT, strict=True))
    steepness = LIGHT[2] / float(np.linalg.norm(LIGHT))
    plotter.add_light(
        pv.Light(position=towards, focal_point=middle, intensity=1 / steepness, light_type=3)
    )


def _flat(
    plotter: Any,
    read: FieldFile,
    values: NDArray[Any],
    limits: tuple[float, float],
    colours: str,
    title: str,
) -> None:
    """One cell a grid point, seen from above: no colour is interpolated."""
    import pyvista as pv

    scale, unit = unit_for(max(read.periods), "m")
    spacing = [d / scale for d in read.spacing]
    image = pv.ImageData(
        dimensions=(*(n + 1 for n in read.shape), 1),
        spacing=(*spacing, 1.0),
        origin=(-spacing[0] / 2, -spacing[1] / 2, 0.0),
    )
    shown = np.where(values > 0, values, np.nan) if limits[0] == 0 else values
    image.cell_data["values"] = shown.ravel(order="F")
    plotter.add_mesh(
        image,
        clim=limits,
        cmap=colours,
        nan_color="white",
        lighting=False,
        scalar_bar_args=bar(title, wide=True),
    )
    plotter.add_mesh(image.outline(), color=GREY)
    size = " × ".join(f"{p / scale:.4g}" for p in read.periods)
    plotter.add_text(f"{size} {unit}", position="upper_left", font_size=10, **TEXT)
    plotter.view_xy()
    plotter.enable_parallel_projection()
    plotter.camera.zoom(1.2)


def _strided(read: FieldFile) -> FieldFile:
    step = max(1, -(-max(read.shape) // POINTS))
    if step == 1:
        return read
    fields = {
        name: field[(slice(None, None, step),) * field.ndim] for name, field in read.fields.items()
    }
    return FieldFile(fields, tuple(d * step for d in read.spacing), read.attributes, read.units)


def _relief_factor(files: Sequence[FieldFile]) -> float:
    """A round factor that shows valleys of ordinary depth at `RELIEF` of the period."""
    depth = max(float(np.quantile(_field(f, "gap")[::4], 0.98)) for f in files)
    return round_factor(RELIEF * max(files[0].periods) / depth) if depth > 0 else 1.0


def _top_of(files: Sequence[FieldFile]) -> float:
    """The upper end of the pressure scale: the hardness where the files know a finite one."""
    tops = []
    for file in files:
        hardness = file.attributes.get("hardness", np.inf)
        known = isinstance(hardness, float) and np.isfinite(hardness)
        tops.append(float(hardness) if known else float(_field(file, "pressure").max()))
    return max(tops) or 1.0


def _field(read: FieldFile, name: str) -> NDArray[Any]:
    if name not in read.fields:
        raise OutputError(f"the file holds no field {name}, only {', '.join(sorted(read.fields))}")
    return read.fields[name]


SCENES: dict[str, Callable[[dict[str, Any]], None]] = {
    "probe": probe,
    "surface": surface,
    "compare": compare,
    "block": block,
    "animate": animate,
}


def main() -> int:
    """Draw the task on standard input."""
    task = json.load(sys.stdin)
    try:
        SCENES[task["scene"]](task)
    except (OutputError, MemoryError) as error:
        print(MARK + (str(error) or "there is not enough memory to draw this"))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
