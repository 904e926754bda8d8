"""Charts of fields: contact from above, two methods compared, a line in profile, convergence maps.

They need only matplotlib, so they work on machines that cannot draw in three dimensions.
It is imported where it is used, because its import takes longer than most commands.  Arrays are
[x, y]; pictures show x to the right and y upward.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.errors import OutputError
from epcontact.output.charts.figures import Chart, new_figure, styled
from epcontact.output.charts.painting import colour_bar, paint_states, show_field
from epcontact.output.charts.style import (
    DIFFERENCE_MAP,
    PRESSURE_MAP,
    STATE_COLOURS,
    STATE_NAMES,
    STRESS_MAP,
    typeset,
    unit_for,
)
from epcontact.output.files import write_bytes
from epcontact.output.vtk import read_fields
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray


def contact_map(
    state: NDArray[Any],
    pressure: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    hardness: float = np.inf,
    caption: str = "",
) -> Chart:
    """Figure 3 of the paper, from above: the contact state and the pressure side by side.

    Points apart are white, elastic ones yellow and plastic ones black, as in the paper.

    Args:
        state: APART, ELASTIC or PLASTIC at each point, of shape (nx, ny).
        pressure: In Pa, of the same shape.
        spacing: Distance of grid points (dx, dy) in m.
        hardness: In Pa; if it is finite, the colour scale ends there.
        caption: Replaces the general caption.

    Example:
        >>> chart = contact_map(np.eye(2), 1e9 * np.eye(2), (1e-6, 1e-6))
        >>> chart.rows[0]
        ('elastic', 0.5)
    """
    top = hardness if np.isfinite(hardness) else float(np.max(pressure))
    scale, unit = unit_for(top, "Pa")
    shares = {kind: float(np.mean(state == kind)) for kind in (ELASTIC, PLASTIC, APART)}
    with styled():
        figure, (left, right) = new_figure(7.4, 3.9, columns=2)
        show_field(left, state, spacing, paint_states)
        mappable, paint = colour_bar(PRESSURE_MAP, 0.0, top / scale, scale, blank=True)
        show_field(right, pressure, spacing, paint)
        bar = figure.colorbar(mappable, ax=right, shrink=0.82)
        bar.set_label(f"pressure ({unit}), white: none")
        left.set_title("contact state (shares of grid points)")
        right.set_title("contact pressure")
        _state_legend(figure, shares)
    general = "Contact state and contact pressure, seen from above."
    rows = [(STATE_NAMES[kind], share) for kind, share in shares.items()]
    rows.append(("mean_pressure_Pa", float(np.mean(pressure, dtype=np.float64))))
    return Chart(figure, ("quantity", "share_of_points_or_value"), rows, caption or general)


def map_of_file(path: Path | str, caption: str = "") -> Chart:
    """The contact map of the fields in a .vti file, or the profile of a line.

    Args:
        path: The path of the file.
        caption: Replaces the general caption.

    Raises:
        OutputError: If the file cannot be read or holds no contact.
    """
    read = read_fields(path)
    missing = {"state", "pressure", "gap"} - read.fields.keys()
    if missing:
        raise OutputError(f"{path} holds no field called {', '.join(sorted(missing))}")
    state, pressure = read.fields["state"], read.fields["pressure"]
    if state.ndim == 1:
        return contact_profile(state, pressure, read.fields["gap"], read.spacing, caption=caption)
    hardness = float(read.attributes.get("hardness", np.inf))
    return contact_map(state, pressure, read.spacing, hardness=hardness, caption=caption)


def save_map(source: Path, target: Path) -> None:
    """Draw the contact map of a .vti file to files.

    Args:
        source: The .vti file.
        target: A .png, or a name without ending for a picture, its data and a caption.

    Raises:
        OutputError: If a file cannot be read or written.
    """
    chart = map_of_file(source)
    if target.suffix == ".png":
        write_bytes(target, chart.png())
    else:
        chart.save(target)


def pressure_difference(
    first: NDArray[Any],
    second: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    names: tuple[str, str] = ("BEM", "FE"),
) -> Chart:
    """The pressures of two methods side by side, in one scale, with their difference.

    Args:
        first, second: Pressures in Pa, of one shape (nx, ny).
        spacing: Distance of grid points (dx, dy) in m.
        names: The names of the two methods.

    Raises:
        ValueError: If the shapes differ.
    """
    if first.shape != second.shape:
        raise ValueError(f"the pressures lie on different grids, {first.shape} and {second.shape}")
    top = float(max(np.max(first), np.max(second)))
    difference = np.asarray(first, dtype=np.float64) - second
    most = float(np.max(np.abs(difference)))
    scale, unit = unit_for(top, "Pa")
    with styled():
        figure, axes = new_figure(10.2, 3.4, columns=3)
        mappable, paint = colour_bar(PRESSURE_MAP, 0.0, top / scale, scale, blank=True)
        for panel, field, name in zip(axes, (first, second), names, strict=False):
            show_field(panel, field, spacing, paint)
            panel.set_title(name)
        figure.colorbar(mappable, ax=axes[:2], shrink=0.82, label=f"pressure ({unit})")
        small, small_unit = unit_for(most, "Pa")
        bound = most / small or 1.0
        mappable, paint = colour_bar(DIFFERENCE_MAP, -bound, bound, small)
        show_field(axes[2], difference, spacing, paint)
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
    """A line contact: the deformed profile under the rigid flat, and the pressure.

    Args:
        state: APART, ELASTIC or PLASTIC at each point, of shape (nx,).
        pressure: In Pa, of the same shape.
        gap: The gap between the body and the flat in m, of the same shape.
        spacing: Distance of grid points (dx,) in m.
        caption: Replaces the general caption.
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
    general = "A line contact: deformed profile under the rigid flat, and pressure."
    names = ("x_m", "state", "pressure_Pa", "gap_m")
    rows = list(zip(x.tolist(), state.tolist(), pressure.tolist(), gap.tolist(), strict=True))
    return Chart(figure, names, rows, caption or general)


def stability_map(
    effort: Mapping[str, ArrayLike],
    x: ArrayLike,
    y: ArrayLike,
    *,
    labels: tuple[str, str],
    count: str = "iterations",
    caption: str = "",
) -> Chart:
    """A map for each method of the parameters at which it converges, and of its effort.

    Args:
        effort: Counts by method, of shape (len(x), len(y)).  NaN means that the method failed
            there; it is drawn as a cross.
        x, y: The parameters, drawn in equal steps.
        labels: Names of the parameters, with units.
        count: Name of the effort.
        caption: Replaces the general caption.

    Raises:
        ValueError: If an effort has another shape.
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
            axes.set(title=name, xlabel=typeset(labels[0]))
            axes.grid(False)
            axes.set_xticks(*_few_ticks(across), rotation=45)
            axes.set_yticks(*_few_ticks(up))
        panels[0].set_ylabel(typeset(labels[1]))
        figure.colorbar(image, ax=list(panels), label=f"{count} (crossed: failed)")
    general = f"{count} of each method; a cross marks where it did not converge."
    rows = [
        (name, float(across[i]), float(up[j]), float(table[i, j]))
        for name, table in tables.items()
        for i, j in np.ndindex(table.shape)
    ]
    return Chart(figure, ("method", labels[0], labels[1], count), rows, caption or general)


def _few_ticks(values: FloatArray) -> tuple[list[int], list[str]]:
    places = np.unique(np.linspace(0, values.size - 1, min(values.size, 6)).astype(int))
    return places.tolist(), [f"{values[i]:.3g}" for i in places]


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
