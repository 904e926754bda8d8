"""Charts of fields: contact from above, two methods compared, a line in profile,
convergence maps.

They need only matplotlib, so they work on machines that cannot draw in three
dimensions.  It is imported where it is used, because its import takes longer than most
commands.  Arrays are [x, y]; pictures show x to the right and y upward.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.errors import OutputError
from epcontact.files import write_bytes
from epcontact.output.charts import style
from epcontact.output.charts.figures import (
    Chart,
    new_figure,
    styled,
    write_question,
)
from epcontact.output.charts.style import (
    FLATTENED,
    STATE_COLOURS,
    STATE_NAMES,
    difference_text,
    label_text,
    typeset,
    unit_for,
)
from epcontact.output.vtk import FieldFile, read_fields
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray

#: Most points along the longer side of a drawn field; finer grids are drawn with a
#: stride.
POINTS = 2048
#: Most labelled values along a side of a convergence map.
_MOST_TICKS = 6
#: Methods in the titles of compared pressures, by the law of elements or by their name.
_TITLES = {
    "j2": "J2 elements",
    "capped": "capped elements",
    "elastic": "elastic elements",
    "bem": "boundary elements",
}
_MAP_CAPTION = "Contact state and contact pressure, seen from above."
_PROFILE_CAPTION = (
    "A line contact: deformed profile under the rigid flat, and pressure."
)


def flattened_depth(fields: Mapping[str, NDArray[Any]]) -> NDArray[Any] | None:
    """Return how deep plastic flow has flattened the spots of a capped body.

    Args:
        fields: arrays of one shape by name, those of a result or of a .vti file.

    Returns:
        The plastic displacement (m), 0 outside of the spots that have flowed at any
        load.  None if the fields have none, or if it is that of J2 flow, which moves
        all points of the surface.
    """
    depth = fields.get("plastic_displacement")
    if depth is None or np.min(depth) < 0 or np.all(depth != 0):
        return None
    return depth


def visible_state(fields: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Return the state of each point as pictures show it.

    Args:
        fields: arrays of one shape by name, with "state".

    Returns:
        The contact states, with FLATTENED at points without contact that an earlier
        load has flattened.
    """
    state = np.array(fields["state"], dtype=np.intp)
    depth = flattened_depth(fields)
    if depth is not None:
        state[(state == APART) & (depth > 0)] = FLATTENED
    return state


def contact_map(
    state: NDArray[Any],
    pressure: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    hardness: float = np.inf,
    caption: str = "",
    depth: NDArray[Any] | None = None,
) -> Chart:
    """Draw Figure 3 of the paper: contact state and pressure from above, side by side.

    Args:
        state: the state [x, y] of each point: APART, ELASTIC, PLASTIC or FLATTENED.
        pressure: the contact pressure [x, y] in Pa.
        spacing: distance of neighbouring points along each direction, in m.
        hardness: the pressure in Pa at which the colour scale ends; infinite: the scale
            ends at the largest pressure.
        caption: the caption of the chart; "" for the usual one.
        depth: the plastic displacement [x, y] in m, which is drawn in place of the
            pressure where no point has a pressure; None: there is none.

    Returns:
        The chart; its data are the fraction of points of each state and the mean
        pressure in Pa.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    right_field, largest, unit, quantity = pressure, hardness, "Pa", "pressure"
    if not np.any(pressure > 0) and depth is not None and np.any(depth > 0):
        right_field, largest = depth, np.inf
        unit, quantity = "m", "plastic displacement"
    if not np.isfinite(largest):
        largest = float(np.max(right_field))
    fractions = {
        kind: float(np.mean(state == kind))
        for kind in (ELASTIC, PLASTIC, APART, FLATTENED)
    }
    if not fractions[FLATTENED]:
        del fractions[FLATTENED]
    state_colours = [STATE_COLOURS[kind] for kind in range(FLATTENED + 1)]
    look = {"cmap": ListedColormap(state_colours), "vmin": APART, "vmax": FLATTENED}
    with styled():
        figure, (left, right) = new_figure(7.4, 3.9, columns=2)
        question = "Where do the faces touch, and where do they flow?"
        if right_field is depth:
            question = "What has the load left behind?"
        write_question(figure, question)
        show_field(left, state, spacing, **look)
        image, unit = _show_positive(right, right_field, spacing, largest, unit)
        bar = figure.colorbar(image, ax=right, shrink=0.82)
        bar.set_label(f"{quantity} ({unit}), white: none")
        left.set_title("contact state (fractions of grid points)")
        right.set_title(f"contact {quantity}" if unit.endswith("Pa") else quantity)
        handles = [
            Patch(
                facecolor=STATE_COLOURS[kind],
                edgecolor="#555555",
                linewidth=0.6,
                label=f"{STATE_NAMES[kind]} {100 * fraction:.2f} %",
            )
            for kind, fraction in fractions.items()
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    rows = [(STATE_NAMES[kind], fraction) for kind, fraction in fractions.items()]
    rows.append(("mean_pressure_Pa", float(np.mean(pressure, dtype=np.float64))))
    header = ("quantity", "share_of_points_or_value")
    return Chart(figure, header, rows, caption or _MAP_CAPTION)


def map_of_file(path: Path | str, caption: str = "") -> Chart:
    """Draw the contact map of a .vti file, or the profile of a line.

    Args:
        path: the file, with the fields state, pressure (Pa) and gap (m).
        caption: the caption of the chart; "" for the usual one.

    Returns:
        The chart of `contact_map` for a surface, that of `contact_profile` for a line.

    Raises:
        OutputError: if the file cannot be read or lacks a field.
    """
    file = read_fields(path)
    for name in ("state", "pressure", "gap"):
        file.field(name)  # raises if it is missing
    return map_of(file.fields, file.spacing, file.hardness, caption)


def map_of(
    fields: Mapping[str, NDArray[Any]],
    spacing: tuple[float, ...],
    hardness: float,
    caption: str,
) -> Chart:
    """Draw the contact map of a surface, or the profile of a line.

    Args:
        fields: the arrays "state" (APART, ELASTIC or PLASTIC), "pressure" (Pa) and
            "gap" (m) of one shape: [x, y] of a surface or [x] of a line; and
            "plastic_displacement" (m) of a body that has flowed.
        spacing: distance of neighbouring points along each direction, in m.
        hardness: the hardness in Pa; infinite for none.
        caption: the caption of the chart; "" for the usual one.
    """
    pressure = fields["pressure"]
    if pressure.ndim == 1:
        state, gap = fields["state"], fields["gap"]
        return contact_profile(state, pressure, gap, spacing, caption=caption)
    return contact_map(
        visible_state(fields),
        pressure,
        spacing,
        hardness=hardness,
        caption=caption,
        depth=fields.get("plastic_displacement"),
    )


def profiles(sources: Sequence[Path]) -> Iterator[Chart]:
    """Draw line contacts from .vti files, each as a profile, all in one scale.

    The axes end at the largest gap and the largest pressure of all files.

    Args:
        sources: the files, with the fields state, pressure (Pa) and gap (m) [x].

    Yields:
        A chart for each file, see `contact_profile`.

    Raises:
        OutputError: if a file cannot be read or lacks a field.
    """
    files = [read_fields(source) for source in sources]
    largest_gap = max(float(file.field("gap").max()) for file in files)
    largest_pressure = max(float(file.field("pressure").max()) for file in files)
    for file in files:
        state, pressure, gap = map(file.field, ("state", "pressure", "gap"))
        limits = (largest_gap, largest_pressure)
        yield contact_profile(state, pressure, gap, file.spacing, limits=limits)


def save_map(source: Path, target: Path) -> None:
    """Draw the contact map of a .vti file and write it.

    Args:
        source: the .vti file, with the fields state, pressure (Pa) and gap (m).
        target: a path that ends with .png for the picture alone; any other path is the
            stem of the four files of a chart, see `Chart.save`.

    Raises:
        OutputError: if a file cannot be read or written, or if a table or a text has
            the name of one of the four files and there is no picture beside it.
    """
    data = [Path(f"{target}{end}") for end in (".csv", ".txt")]
    if any(map(Path.exists, data)) and not Path(f"{target}.png").exists():
        raise OutputError(
            f"cannot write {target}.csv and .txt: one exists that belongs to no "
            "picture; give another name"
        )
    chart = map_of_file(source)
    if target.suffix == ".png":
        write_bytes(target, chart.png())
    else:
        chart.save(target)


def compare_pressures(first: FieldFile, second: FieldFile) -> Chart:
    """Draw the pressures of two files of fields on one grid, see `pressure_difference`.

    The title of each has the law of the elements or the kind of the solver, and the
    name of its method, such as "J2 elements (fem)".  Two files with the same title are
    told apart by their names.

    Raises OutputError if a file has no pressure.
    """
    titles = []
    for file in (first, second):
        method = str(file.attributes.get("method", "?"))
        words = _TITLES.get(str(file.attributes.get("option.law", method)), "")
        titles.append(f"{words} ({method})" if words else method)
    if titles[0] == titles[1]:
        titles = [f"{titles[0]} {Path(file.source).stem}" for file in (first, second)]
    pressures = (first.field("pressure"), second.field("pressure"))
    return pressure_difference(*pressures, first.spacing, names=(titles[0], titles[1]))


def pressure_difference(
    first: NDArray[Any],
    second: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    names: tuple[str, str] = ("BEM", "FE"),
) -> Chart:
    """Draw the pressures of two methods side by side, in one scale, with their
    difference.

    Args:
        first, second: the contact pressures [x, y] in Pa.
        spacing: distance of neighbouring points along each direction, in m.
        names: the names of the two methods.

    Returns:
        The chart; its data are, in Pa, the largest pressure and difference, the rms
        difference and both mean pressures, and the rms difference over the rms of the
        second pressure.  The difference is first minus second.
    """
    largest = float(max(np.max(first), np.max(second)))
    difference = np.asarray(first, dtype=np.float64) - second
    largest_difference = float(np.max(np.abs(difference)))
    second_norm = float(np.linalg.norm(second)) or 1.0
    relative = float(np.linalg.norm(difference)) / second_norm
    with styled():
        figure, axes = new_figure(10.2, 3.4, columns=3)
        left, middle, right = axes
        write_question(figure, "Do both methods find the same pressures?")
        image, unit = _show_positive(left, first, spacing, largest)
        image, unit = _show_positive(middle, second, spacing, largest)
        figure.colorbar(image, ax=axes[:2], shrink=0.82, label=f"pressure ({unit})")
        scale, unit = unit_for(largest_difference, "Pa")
        bound = largest_difference / scale or 1.0
        look = {"cmap": style.DIFFERENCE_MAP, "vmin": -bound, "vmax": bound}
        image = show_field(right, difference / scale, spacing, **look)
        label = f"left minus middle ({unit})"
        figure.colorbar(image, ax=right, shrink=0.82, label=label)
        left.set_title(label_text(names[0]))
        middle.set_title(label_text(names[1]))
        right.set_title(f"difference, rms: {difference_text(relative)}")
    rows = [
        ("largest_pressure_Pa", largest),
        ("largest_difference_Pa", largest_difference),
        ("rms_difference_Pa", float(np.sqrt(np.mean(difference**2)))),
        ("mean_pressure_first_Pa", float(np.mean(first, dtype=np.float64))),
        ("mean_pressure_second_Pa", float(np.mean(second, dtype=np.float64))),
        ("rms_difference_over_second", relative),
    ]
    caption = (
        f"Contact pressure by {names[0]} and by {names[1]}, and their difference, "
        f"which is {difference_text(relative)} in the mean square."
    )
    return Chart(figure, ("quantity", "value"), rows, caption)


def contact_profile(
    state: NDArray[Any],
    pressure: NDArray[Any],
    gap: NDArray[Any],
    spacing: tuple[float, ...],
    *,
    caption: str = "",
    limits: tuple[float, float] | None = None,
) -> Chart:
    """Draw a line contact: the deformed profile under the rigid flat, and the pressure.

    Args:
        state: the contact state [x] of each point: APART, ELASTIC or PLASTIC.
        pressure: the contact pressure [x] in Pa.
        gap: the gap [x] in m.
        spacing: distance of neighbouring points in m, one number.
        caption: the caption of the chart; "" for the usual one.
        limits: the gap (m) and the pressure (Pa) at which the axes end; None: the
            largest ones.

    Returns:
        The chart; its data are the arguments at every point.
    """
    x = np.arange(state.size) * spacing[0]
    depth = np.maximum(gap, 0.0)
    if limits is None:
        limits = (float(np.max(depth)), float(np.max(pressure)))
    x_scale, x_unit = unit_for(state.size * spacing[0], "m")
    depth_scale, depth_unit = unit_for(limits[0], "m")
    pressure_scale, pressure_unit = unit_for(limits[1], "Pa")
    deepest = limits[0] / depth_scale
    with styled():
        figure, (left, right) = new_figure(8.4, 3.2, columns=2)
        write_question(figure, "Where does the line touch, and where does it flow?")
        left.fill_between(
            x / x_scale, -depth / depth_scale, -1.05 * deepest, color="#d9d9d9"
        )
        for kind in (ELASTIC, PLASTIC):
            left.fill_between(
                x / x_scale,
                0.0,
                0.04 * deepest,
                where=state == kind,
                step="mid",
                linewidth=1.0,
                color=STATE_COLOURS[kind],
                label=f"{STATE_NAMES[kind]} contact",
            )
        left.set_ylabel(f"height below the flat ({depth_unit})")
        left.set_title("profile in contact")
        left.legend(loc="lower right", frameon=True)
        right.fill_between(
            x / x_scale, pressure / pressure_scale, step="mid", color="#0072b2"
        )
        right.set_ylabel(f"pressure ({pressure_unit})")
        right.set_ylim(0, 1.05 * limits[1] / pressure_scale or None)
        mean = float(np.mean(pressure)) / pressure_scale
        right.set_title(f"contact pressure, mean {mean:.4g} {pressure_unit}")
        for axes in (left, right):
            axes.margins(x=0)
            axes.set_xlabel(f"x ({x_unit})")
    columns = [column.tolist() for column in (x, state, pressure, gap)]
    rows = [*zip(*columns, strict=True)]
    header = ("x_m", "state", "pressure_Pa", "gap_m")
    return Chart(figure, header, rows, caption or _PROFILE_CAPTION)


def stability_map(
    effort: Mapping[str, ArrayLike],
    x: ArrayLike,
    y: ArrayLike,
    *,
    labels: tuple[str, str],
    count: str,
    caption: str,
    question: str = "Where do the methods converge?",
) -> Chart:
    """Draw for each method at which parameters it converges, and by what effort.

    Args:
        effort: the effort of each method, an array (len(x), len(y)).  NaN means that
            the method failed, which a cross shows.
        x, y: the values of the two parameters, in the units that `labels` states.
        labels: the labels of the x and the y axis, with units.
        count: the name of the effort, such as "FFT pairs", for the colour bar.
        caption: the caption of the chart.
        question: the question that the chart answers, above it.

    Returns:
        The chart; its data have a row for each method and pair of parameters.
    """
    from matplotlib.colors import LogNorm

    x_values = np.ravel(x).astype(np.float64)
    y_values = np.ravel(y).astype(np.float64)
    tables = {name: np.asarray(e, dtype=np.float64) for name, e in effort.items()}
    efforts = np.concatenate([np.ravel(table) for table in tables.values()])
    efforts = efforts[np.isfinite(efforts)]
    lowest = 1.0
    highest = 10.0
    if efforts.size:
        lowest = float(efforts.min())
        highest = float(efforts.max())
    norm = LogNorm(max(lowest, 1.0), max(highest, lowest + 1.0, 2.0))
    with styled():
        figure, panels = new_figure(1.6 + 2.6 * len(tables), 3.3, columns=len(tables))
        write_question(figure, question)
        for axes, (name, table) in zip(panels, tables.items(), strict=True):
            image = axes.imshow(
                table.T,
                origin="lower",
                aspect="auto",
                cmap=style.STRESS_MAP,
                norm=norm,
            )
            failed_x, failed_y = np.nonzero(~np.isfinite(table))
            cross = {"color": "#d55e00", "markersize": 6, "markeredgewidth": 1.6}
            axes.plot(failed_x, failed_y, "x", **cross)
            axes.set(title=name, xlabel=typeset(labels[0]))
            axes.grid(False)
            axes.set_xticks(*_few_ticks(x_values), rotation=45)
            axes.set_yticks(*_few_ticks(y_values))
        panels[0].set_ylabel(typeset(labels[1]))
        figure.colorbar(image, ax=list(panels), label=f"{count} (crossed: failed)")
    rows = []
    for name, table in tables.items():
        for i, j in np.ndindex(table.shape):
            numbers = (x_values[i], y_values[j], table[i, j])
            rows.append((name, *map(float, numbers)))
    return Chart(figure, ("method", *labels, count), rows, caption)


def _few_ticks(values: FloatArray) -> tuple[list[int], list[str]]:
    """Return the ticks of an axis on which each value has a cell of width 1.

    Args:
        values: the value of each cell, shape (n,).

    Returns:
        The indices of at most six evenly spread cells, and their values as texts.
    """
    count = min(values.size, _MOST_TICKS)
    places = np.unique(np.linspace(0, values.size - 1, count).astype(int))
    return places.tolist(), [f"{values[place]:.3g}" for place in places]


def show_field(
    axes: Any, field: NDArray[Any], spacing: tuple[float, ...], **look: Any
) -> Any:
    """Draw a field as an image of one period.

    If several points share a pixel, their colours are averaged and not their values,
    because a state has no mean and a thin contact must remain visible.

    Args:
        axes: the axes of matplotlib.  Its labels and limits are set, too.
        field: the values [x, y], in the unit of the colour scale.
        spacing: distance of neighbouring points along each direction, in m.
        look: keywords of `Axes.imshow`, such as the colour map.

    Returns:
        The image of matplotlib.
    """
    stride = -(-max(field.shape) // POINTS)
    periods = np.multiply(field.shape, spacing)
    scale, unit = unit_for(float(periods.max()), "m")
    # The first grid point is at the origin, each is the centre of its pixel, and the
    # first ones follow once more, so that the picture is one period.
    points = [np.arange(0, count + stride, stride) % count for count in field.shape]
    drawn = field[np.ix_(*points)]
    extent = []
    for count, distance in zip(drawn.shape, spacing, strict=True):
        pixel = stride * distance / scale
        extent += [-0.5 * pixel, (count - 0.5) * pixel]
    image = axes.imshow(
        drawn.T, interpolation_stage="rgba", origin="lower", extent=extent, **look
    )
    width, height = periods / scale
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.grid(False)
    return image


def _show_positive(
    axes: Any,
    field: NDArray[Any],
    spacing: tuple[float, ...],
    largest: float,
    unit: str = "Pa",
) -> tuple[Any, str]:
    """Draw a field, such as the pressure, white where it is not positive.

    Args:
        axes: the axes of matplotlib.
        field: the values [x, y], in `unit`.
        spacing: distance of neighbouring points along each direction, in m.
        largest: the value at which the colour scale ends, in `unit`.
        unit: the SI unit of the field.

    Returns:
        The image of matplotlib and the unit of its values, such as "MPa".
    """
    scale, unit = unit_for(largest, unit)
    scaled = np.asarray(field, dtype=np.float32) / scale
    positive = np.ma.masked_less_equal(scaled, 0.0)
    look = {"cmap": style.PRESSURE_MAP, "vmin": 0.0, "vmax": largest / scale}
    return show_field(axes, positive, spacing, **look), unit
