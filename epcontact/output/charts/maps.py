"""Pictures of fields: contact state and pressure from above, two methods and their difference,
a line in profile, and maps of where a method converges.

They need matplotlib alone, so that they exist where nothing can be rendered in three dimensions.
Arrays are [x, y]; pictures show x to the right and y upward.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.errors import OutputError
from epcontact.output.charts.figures import Chart, new_figure, styled
from epcontact.output.charts.style import (
    DIFFERENCE_MAP,
    PRESSURE_MAP,
    STATE_COLOURS,
    STATE_NAMES,
    STRESS_MAP,
    unit_for,
)
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray

#: Pixels along the longer side of a field's picture; more points are averaged in colour.
PIXELS = 800


def contact_map(
    state: NDArray[Any],
    pressure: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    hardness: float = np.inf,
    caption: str = "",
) -> Chart:
    """Contact state (elastic yellow, plastic black, apart white) and pressure side by side.

    state, pressure: (nx, ny), the latter in Pa; spacing: (dx, dy) in m.
    """
    top = hardness if np.isfinite(hardness) else float(np.max(pressure))
    scale, unit = unit_for(top, "Pa")
    shares = {kind: float(np.mean(state == kind)) for kind in (ELASTIC, PLASTIC, APART)}
    with styled():
        figure, (left, right) = new_figure(7.4, 3.9, columns=2)
        _show(left, state, spacing, _state_colours)
        mappable, paint = _painter(PRESSURE_MAP, 0.0, top / scale, scale, blank=True)
        _show(right, pressure, spacing, paint)
        bar = figure.colorbar(mappable, ax=right, shrink=0.82)
        bar.set_label(f"pressure ({unit}), white: none")
        left.set_title("contact state")
        right.set_title("contact pressure")
        _state_legend(figure, shares)
    told = caption or "Contact state and contact pressure, seen from above."
    rows = [(STATE_NAMES[kind], share) for kind, share in shares.items()]
    rows.append(("mean_pressure_Pa", float(np.mean(pressure, dtype=np.float64))))
    return Chart(figure, ("quantity", "share_of_points_or_value"), rows, told)


def map_of_file(path: Path | str, caption: str = "") -> Chart:
    """The contact map of the fields in a .vti file, or the profile of a line.

    Raises OutputError if the file cannot be read or holds no contact.
    """
    from epcontact.output.vtk import read_fields

    read = read_fields(path)
    missing = {"state", "pressure", "gap"} - read.fields.keys()
    if missing:
        raise OutputError(f"{path} holds no field called {', '.join(sorted(missing))}")
    state, pressure = read.fields["state"], read.fields["pressure"]
    if state.ndim == 1:
        return contact_profile(state, pressure, read.fields["gap"], read.spacing, caption=caption)
    hardness = float(read.attributes.get("hardness", np.inf))
    return contact_map(state, pressure, read.spacing, hardness=hardness, caption=caption)


def pressure_difference(
    first: NDArray[Any],
    second: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    names: tuple[str, str] = ("BEM", "FE"),
) -> Chart:
    """The pressures (nx, ny) of two methods side by side, in one scale, with their difference."""
    if first.shape != second.shape:
        raise ValueError(f"the pressures lie on different grids, {first.shape} and {second.shape}")
    top = float(max(np.max(first), np.max(second)))
    difference = np.asarray(first, dtype=np.float64) - second
    most = float(np.max(np.abs(difference)))
    scale, unit = unit_for(top, "Pa")
    with styled():
        figure, axes = new_figure(10.2, 3.4, columns=3)
        mappable, paint = _painter(PRESSURE_MAP, 0.0, top / scale, scale, blank=True)
        for panel, field, name in zip(axes, (first, second), names, strict=False):
            _show(panel, field, spacing, paint)
            panel.set_title(name)
        figure.colorbar(mappable, ax=axes[:2], shrink=0.82, label=f"pressure ({unit})")
        small, small_unit = unit_for(most, "Pa")
        bound = most / small or 1.0
        mappable, paint = _painter(DIFFERENCE_MAP, -bound, bound, small)
        _show(axes[2], difference, spacing, paint)
        axes[2].set_title(f"{names[0]} minus {names[1]}")
        figure.colorbar(mappable, ax=axes[2], shrink=0.82, label=f"difference ({small_unit})")
    caption = f"Contact pressure by {names[0]} and by {names[1]}, and their difference."
    rows = [
        ("largest_pressure_Pa", top),
        ("largest_difference_Pa", most),
        ("rms_difference_Pa", float(np.sqrt(np.mean(difference**2)))),
        ("mean_pressure_first_Pa", float(np.mean(first, dtype=np.float64))),
        ("mean_pressure_second_Pa", float(np.mean(second, dtype=np.float64))),
    ]
    return Chart(figure, ("quantity", "value"), rows, caption)


def contact_profile(
    state: NDArray[Any],
    pressure: NDArray[Any],
    gap: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    caption: str = "",
) -> Chart:
    """A line contact: the deformed profile under the rigid flat, and the pressure above it.

    state, pressure (Pa), gap (m): (nx,); spacing: (dx,) in m.
    """
    count = state.size
    across, length_unit = unit_for(count * spacing[0], "m")
    x = np.arange(count) * spacing[0]
    depth = np.maximum(gap, 0.0)
    up, height_unit = unit_for(float(np.max(depth)), "m")
    scale, unit = unit_for(float(np.max(pressure)), "Pa")
    with styled():
        figure, (left, right) = new_figure(8.4, 3.2, columns=2)
        left.fill_between(x / across, -depth / up, -1.05 * depth.max() / up, color="#d9d9d9")
        for kind in (ELASTIC, PLASTIC):
            left.fill_between(
                x / across,
                0.0,
                0.04 * depth.max() / up,
                where=state == kind,
                step="mid",
                color=STATE_COLOURS[kind],
                linewidth=1.0,
                label=f"{STATE_NAMES[kind]} contact",
            )
        left.set(ylabel=f"height below the flat ({height_unit})", title="profile in contact")
        left.margins(x=0)
        left.legend(loc="lower right", frameon=True)
        right.fill_between(x / across, pressure / scale, step="mid", color="#0072b2")
        right.set(ylabel=f"pressure ({unit})", ylim=(0, None), title="contact pressure")
        right.margins(x=0)
        for axes in (left, right):
            axes.set_xlabel(f"x ({length_unit})")
    told = caption or "A line contact: deformed profile under the rigid flat, and pressure."
    names = ("x_m", "state", "pressure_Pa", "gap_m")
    rows = list(zip(x.tolist(), state.tolist(), pressure.tolist(), gap.tolist(), strict=True))
    return Chart(figure, names, rows, told)


def stability_map(
    effort: Mapping[str, ArrayLike],
    x: ArrayLike,
    y: ArrayLike,
    *,
    labels: tuple[str, str],
    count: str = "iterations",
    caption: str = "",
) -> Chart:
    """Where each method converges, and how fast.

    effort: (len(x), len(y)) counts by method; NaN where it failed (drawn crossed).  x, y: the
    parameters, drawn in equal steps; labels: their names with units.
    """
    across, up = (np.asarray(v, dtype=np.float64).ravel() for v in (x, y))
    tables = {name: np.asarray(e, dtype=np.float64) for name, e in effort.items()}
    for name, table in tables.items():
        if table.shape != (across.size, up.size):
            raise ValueError(f"{name} has shape {table.shape}, not {(across.size, up.size)}")
    known = np.concatenate([t[np.isfinite(t)] for t in tables.values()] or [np.ones(0)])
    from matplotlib.colors import LogNorm

    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 10.0)
    with styled():
        width = 1.6 + 2.6 * len(tables)
        figure, panels = new_figure(width, 3.3, columns=len(tables))
        norm = LogNorm(max(low, 1.0), max(high, low + 1.0, 2.0))
        for axes, (name, table) in zip(panels, tables.items(), strict=True):
            image = axes.imshow(table.T, origin="lower", aspect="auto", cmap=STRESS_MAP, norm=norm)
            failed = np.argwhere(~np.isfinite(table))
            axes.plot(*failed.T, "x", color="#d55e00", markersize=6, markeredgewidth=1.6)
            axes.set(title=name, xlabel=labels[0])
            axes.grid(False)
            axes.set_xticks(*_few_ticks(across), rotation=45)
            axes.set_yticks(*_few_ticks(up))
        panels[0].set_ylabel(labels[1])
        figure.colorbar(image, ax=list(panels), label=f"{count} (crossed: failed)")
    told = caption or f"{count} of each method; a cross marks where it did not converge."
    rows = [
        (name, float(across[i]), float(up[j]), float(table[i, j]))
        for name, table in tables.items()
        for i, j in np.ndindex(table.shape)
    ]
    return Chart(figure, ("method", labels[0], labels[1], count), rows, told)


def _few_ticks(values: FloatArray) -> tuple[list[int], list[str]]:
    places = np.unique(np.linspace(0, values.size - 1, min(values.size, 6)).astype(int))
    return places.tolist(), [f"{values[i]:.3g}" for i in places]


def _show(
    axes: Any,
    field: NDArray[Any],
    spacing: tuple[float, ...],
    paint: Callable[[NDArray[Any]], NDArray[Any]],
) -> None:
    periods = [n * d for n, d in zip(field.shape, spacing, strict=True)]
    scale, unit = unit_for(max(periods), "m")
    # Grid point 0 at the origin: each point is the middle of its pixel.
    extent = [
        edge * d / scale
        for n, d in zip(field.shape, spacing, strict=True)
        for edge in (-0.5, n - 0.5)
    ]
    picture = shrunk(field, paint)
    axes.imshow(picture.transpose(1, 0, 2), origin="lower", extent=extent)
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    axes.grid(False)


def shrunk(
    field: NDArray[Any], paint: Callable[[NDArray[Any]], NDArray[Any]], pixels: int = PIXELS
) -> NDArray[np.float32]:
    """The colours (mx, my, 3) of `field` (nx, ny), averaged to at most `pixels` a side.

    Colours are averaged, not values: a state has no mean, and a thin contact keeps its share of
    ink.  The rows are painted a few at a time, so that memory stays that of the picture.
    """
    edges = [np.linspace(0, n, min(n, pixels) + 1).astype(np.intp) for n in field.shape]
    picture = np.empty((edges[0].size - 1, edges[1].size - 1, 3), dtype=np.float32)
    widths = np.diff(edges[1])[:, None]
    for i, (start, stop) in enumerate(zip(edges[0], edges[0][1:], strict=False)):
        colours = paint(np.asarray(field[start:stop]))[..., :3].mean(axis=0)
        picture[i] = np.add.reduceat(colours, edges[1][:-1], axis=0) / widths
    return picture


def _state_colours(states: NDArray[Any]) -> NDArray[Any]:
    from matplotlib.colors import to_rgb

    table = np.array([to_rgb(STATE_COLOURS[kind]) for kind in (APART, ELASTIC, PLASTIC)])
    return table[np.asarray(states, dtype=np.intp)]


def _painter(
    name: str, low: float, high: float, scale: float, *, blank: bool = False
) -> tuple[Any, Callable[[NDArray[Any]], NDArray[Any]]]:
    """A colour bar's mappable and the function that paints values; `blank`: zeros white."""
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    mappable = ScalarMappable(Normalize(low, high), mpl.colormaps[name])

    def paint(values: NDArray[Any]) -> NDArray[Any]:
        colours: NDArray[Any] = mappable.to_rgba(np.asarray(values, dtype=np.float64) / scale)
        if blank:
            colours[values <= 0] = 1.0
        return colours

    return mappable, paint


def _state_legend(figure: Any, shares: Mapping[int, float]) -> None:
    from matplotlib.patches import Patch

    figure.legend(
        handles=[
            Patch(
                facecolor=STATE_COLOURS[kind],
                edgecolor="#555555",
                linewidth=0.6,
                label=f"{STATE_NAMES[kind]} {100 * share:.2f} %",
            )
            for kind, share in shares.items()
        ],
        loc="outside lower center",
        ncols=3,
    )
