"""Charts of fields: contact from above, two methods compared, a line in profile,
convergence maps.

They need only matplotlib, so they work on machines that cannot draw in three
dimensions. It is imported where it is used, because its import takes longer than most
commands.  Arrays are [x, y]; pictures show x to the right and y upward.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.files import write_bytes
from epcontact.output.charts import style
from epcontact.output.charts.figures import Chart, new_figure, styled
from epcontact.output.charts.style import STATE_COLOURS, STATE_NAMES, typeset, unit_for
from epcontact.output.vtk import read_fields
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray

#: Most points along the longer side of a drawn field; finer grids are drawn with a
#: stride.
POINTS = 2048


def contact_map(
    state: NDArray[Any],
    pressure: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    hardness: float = np.inf,
    caption: str = "",
) -> Chart:
    """Figure 3 of the paper, from above: the contact state and the pressure side by
    side.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    top = hardness if np.isfinite(hardness) else float(np.max(pressure))
    shares = {kind: float(np.mean(state == kind)) for kind in (ELASTIC, PLASTIC, APART)}
    colours = ListedColormap(
        [STATE_COLOURS[kind] for kind in (APART, ELASTIC, PLASTIC)]
    )
    with styled():
        figure, (left, right) = new_figure(7.4, 3.9, columns=2)
        show_field(left, state, spacing, cmap=colours, vmin=APART, vmax=PLASTIC)
        image, unit = _show_pressure(right, pressure, spacing, top)
        bar = figure.colorbar(image, ax=right, shrink=0.82)
        bar.set_label(f"pressure ({unit}), white: none")
        left.set_title("contact state (shares of grid points)")
        right.set_title("contact pressure")
        handles = [
            Patch(
                facecolor=STATE_COLOURS[kind],
                edgecolor="#555555",
                linewidth=0.6,
                label=f"{STATE_NAMES[kind]} {100 * share:.2f} %",
            )
            for kind, share in shares.items()
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    rows = [(STATE_NAMES[kind], share) for kind, share in shares.items()]
    rows.append(("mean_pressure_Pa", float(np.mean(pressure, dtype=np.float64))))
    caption = caption or "Contact state and contact pressure, seen from above."
    return Chart(figure, ("quantity", "share_of_points_or_value"), rows, caption)


def map_of_file(path: Path | str, caption: str = "") -> Chart:
    """The contact map of the fields in a .vti file, or the profile of a line.  Raises
    OutputError if the file cannot be read or holds no contact.
    """
    file = read_fields(path)
    fields = {name: file.field(name) for name in ("state", "pressure", "gap")}
    return map_of(fields, file.spacing, file.hardness, caption)


def map_of(
    fields: Mapping[str, NDArray[Any]],
    spacing: tuple[float, ...],
    hardness: float,
    caption: str,
) -> Chart:
    """The contact map of fields, or the profile of a line."""
    state, pressure, gap = (fields[name] for name in ("state", "pressure", "gap"))
    if state.ndim == 1:
        return contact_profile(state, pressure, gap, spacing, caption=caption)
    return contact_map(state, pressure, spacing, hardness=hardness, caption=caption)


def profiles(sources: Sequence[Path]) -> Iterator[Chart]:
    """Draw the lines in .vti files, each as a profile, all in the scales of the
    largest.
    """
    files = [read_fields(source) for source in sources]
    deepest, top = (
        max(float(f.field(n).max()) for f in files) for n in ("gap", "pressure")
    )
    for f in files:
        state, pressure, gap = (f.field(name) for name in ("state", "pressure", "gap"))
        yield contact_profile(state, pressure, gap, f.spacing, tops=(deepest, top))


def save_map(source: Path, target: Path) -> None:
    """Draw the contact map of a .vti file to a .png, or to all files of a chart.
    Raises OutputError if a file cannot be read or written.
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
    """The pressures (Pa) of two methods side by side, in one scale, with their
    difference.
    """
    top = float(max(np.max(first), np.max(second)))
    difference = np.asarray(first, dtype=np.float64) - second
    most = float(np.max(np.abs(difference)))
    with styled():
        figure, axes = new_figure(10.2, 3.4, columns=3)
        for panel, field, name in zip(axes, (first, second), names, strict=False):
            image, unit = _show_pressure(panel, field, spacing, top)
            panel.set_title(name)
        figure.colorbar(image, ax=axes[:2], shrink=0.82, label=f"pressure ({unit})")
        scale, unit = unit_for(most, "Pa")
        bound = most / scale or 1.0
        look = {"cmap": style.DIFFERENCE_MAP, "vmin": -bound, "vmax": bound}
        image = show_field(axes[2], difference / scale, spacing, **look)
        axes[2].set_title(f"{names[0]} minus {names[1]}")
        figure.colorbar(image, ax=axes[2], shrink=0.82, label=f"difference ({unit})")
    rows = [
        ("largest_pressure_Pa", top),
        ("largest_difference_Pa", most),
        ("rms_difference_Pa", float(np.sqrt(np.mean(difference**2)))),
        ("mean_pressure_first_Pa", float(np.mean(first, dtype=np.float64))),
        ("mean_pressure_second_Pa", float(np.mean(second, dtype=np.float64))),
    ]
    caption = f"Contact pressure by {names[0]} and by {names[1]}, and their difference."
    return Chart(figure, ("quantity", "value"), rows, caption)


def contact_profile(
    state: NDArray[Any],
    pressure: NDArray[Any],
    gap: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    caption: str = "",
    tops: tuple[float, float] | None = None,
) -> Chart:
    """A line contact: the deformed profile under the rigid flat, and the pressure.  The
    axes end at `tops`, a gap (m) and a pressure (Pa), by default the largest.
    """
    x, depth = np.arange(state.size) * spacing[0], np.maximum(gap, 0.0)
    deepest, top = tops or (float(np.max(depth)), float(np.max(pressure)))
    across, length_unit = unit_for(state.size * spacing[0], "m")
    (up, height_unit), (scale, unit) = unit_for(deepest, "m"), unit_for(top, "Pa")
    with styled():
        figure, (left, right) = new_figure(8.4, 3.2, columns=2)
        left.fill_between(
            x / across, -depth / up, -1.05 * deepest / up, color="#d9d9d9"
        )
        for kind in (ELASTIC, PLASTIC):
            look = {
                "color": STATE_COLOURS[kind],
                "label": f"{STATE_NAMES[kind]} contact",
            }
            bar = {"where": state == kind, "step": "mid", "linewidth": 1.0}
            left.fill_between(x / across, 0.0, 0.04 * deepest / up, **bar, **look)
        left.set(
            ylabel=f"height below the flat ({height_unit})", title="profile in contact"
        )
        left.legend(loc="lower right", frameon=True)
        right.fill_between(x / across, pressure / scale, step="mid", color="#0072b2")
        mean = f"contact pressure, mean {float(np.mean(pressure)) / scale:.4g} {unit}"
        right.set(
            ylabel=f"pressure ({unit})",
            ylim=(0, 1.05 * top / scale or None),
            title=mean,
        )
        for axes in (left, right):
            axes.margins(x=0)
            axes.set_xlabel(f"x ({length_unit})")
    names = ("x_m", "state", "pressure_Pa", "gap_m")
    rows = list(
        zip(*(column.tolist() for column in (x, state, pressure, gap)), strict=True)
    )
    caption = (
        caption
        or "A line contact: deformed profile under the rigid flat, and pressure."
    )
    return Chart(figure, names, rows, caption)


def stability_map(
    effort: Mapping[str, ArrayLike],
    x: ArrayLike,
    y: ArrayLike,
    *,
    labels: tuple[str, str],
    count: str,
    caption: str,
) -> Chart:
    """A map for each method of the parameters at which it converges, and of its effort.
    An effort has the shape (len(x), len(y)); NaN means that the method failed there,
    which a cross shows.
    """
    from matplotlib.colors import LogNorm

    across, up = (np.asarray(v, dtype=np.float64).ravel() for v in (x, y))
    tables = {name: np.asarray(e, dtype=np.float64) for name, e in effort.items()}
    known = np.concatenate([t[np.isfinite(t)] for t in tables.values()])
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 10.0)
    norm = LogNorm(max(low, 1.0), max(high, low + 1.0, 2.0))
    with styled():
        figure, panels = new_figure(1.6 + 2.6 * len(tables), 3.3, columns=len(tables))
        for axes, (name, table) in zip(panels, tables.items(), strict=True):
            look = {"cmap": style.STRESS_MAP, "norm": norm}
            image = axes.imshow(table.T, origin="lower", aspect="auto", **look)
            failed = np.argwhere(~np.isfinite(table))
            axes.plot(
                *failed.T, "x", color="#d55e00", markersize=6, markeredgewidth=1.6
            )
            axes.set(title=name, xlabel=typeset(labels[0]))
            axes.grid(False)
            axes.set_xticks(*_few_ticks(across), rotation=45)
            axes.set_yticks(*_few_ticks(up))
        panels[0].set_ylabel(typeset(labels[1]))
        figure.colorbar(image, ax=list(panels), label=f"{count} (crossed: failed)")
    rows = [
        (name, float(across[i]), float(up[j]), float(table[i, j]))
        for name, table in tables.items()
        for i, j in np.ndindex(table.shape)
    ]
    return Chart(figure, ("method", labels[0], labels[1], count), rows, caption)


def _few_ticks(values: FloatArray) -> tuple[list[int], list[str]]:
    places = np.unique(np.linspace(0, values.size - 1, min(values.size, 6)).astype(int))
    return places.tolist(), [f"{values[i]:.3g}" for i in places]


def show_field(
    axes: Any, field: NDArray[Any], spacing: tuple[float, ...], **look: Any
) -> Any:
    """Draw a field (nx, ny) as an image with `look`, and return the image.  Where
    several points share a pixel, colours are averaged and not values, because a state
    has no mean and a thin contact must remain visible.
    """
    step = -(-max(field.shape) // POINTS)
    width, height = periods = np.multiply(field.shape, spacing)
    scale, unit = unit_for(float(periods.max()), "m")
    # The first grid point is at the origin, each is the centre of its pixel, and the
    # first ones follow once more, so that the picture is one period.
    drawn = field[np.ix_(*(np.arange(0, n + step, step) % n for n in field.shape))]
    pixels = list(zip(drawn.shape, spacing, strict=True))
    extent = [edge * step * d / scale for n, d in pixels for edge in (-0.5, n - 0.5)]
    averaged = {"interpolation_stage": "rgba", "origin": "lower", "extent": extent}
    image = axes.imshow(drawn.T, **averaged, **look)
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    axes.set(xlim=(0, width / scale), ylim=(0, height / scale))
    axes.grid(False)
    return image


def _show_pressure(
    axes: Any, pressure: NDArray[Any], spacing: tuple[float, ...], top: float
) -> tuple[Any, str]:
    """Draw a pressure (Pa) up to `top`, white where there is none; return image and
    unit.
    """
    scale, unit = unit_for(top, "Pa")
    shown = np.ma.masked_less_equal(np.asarray(pressure, dtype=np.float32) / scale, 0.0)
    look = {"cmap": style.PRESSURE_MAP, "vmin": 0.0, "vmax": top / scale}
    return show_field(axes, shown, spacing, **look), unit
