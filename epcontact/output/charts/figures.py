"""A chart is a picture, its data and a caption, which are saved together or not at all.

Figures are made without pyplot, so that no window can open, and threads or a user's own matplotlib
session are not affected.  Matplotlib is imported where it is used, because its import takes longer
than most commands.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from epcontact.output.charts.style import SETTINGS, series_looks
from epcontact.output.files import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Series:
    """One named line of a chart.

    Args:
        name: Its entry in the legend and in the data.
        x, y: Array-likes of equal length, kept as float64 arrays.  Values that are not finite
            are left out of the picture.
        low, high: Bounds of y, drawn as error bars of points or as the band of a curve.
        line: Draw a curve without marks, as for a theory, rather than points.

    Raises:
        ValueError: If the lengths differ, or one bound is given without the other.

    Example:
        >>> Series("bem", [1, 2], [0.1, 0.2]).y
        array([0.1, 0.2])
    """

    name: str
    x: Any
    y: Any
    low: Any = None
    high: Any = None
    line: bool = False

    def __post_init__(self) -> None:
        for key in ("x", "y", "low", "high"):
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, np.asarray(value, dtype=np.float64).ravel())
        sizes = {np.size(v) for v in (self.x, self.y, self.low, self.high) if v is not None}
        if len(sizes) != 1 or (self.low is None) != (self.high is None):
            raise ValueError(f"the series {self.name!r} has values of unequal number: {sizes}")


@dataclass(frozen=True)
class Chart:
    """A picture with its data and its caption.

    Args:
        figure: A matplotlib Figure that belongs to no pyplot session.
        header: Names of the columns of the data, with their units.
        rows: The data that are drawn.
        caption: Sentences that describe the picture.
    """

    figure: Figure
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str

    def __post_init__(self) -> None:
        # The layout is computed once: repeated at every drawing it shifts, and the same chart
        # would give different bytes.
        with styled():
            self.figure.draw_without_rendering()
            self.figure.set_layout_engine("none")

    def png(self, dots_per_inch: float | None = None) -> bytes:
        """The picture as PNG."""
        return self._bytes("png", dots_per_inch, {"Software": None})

    def svg(self) -> bytes:
        """The picture as SVG: the same bytes for the same data."""
        return self._bytes("svg", None, {"Date": None, "Creator": None})

    def csv(self) -> str:
        """The data as comma-separated values, every float with all its digits."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows([_cell(value) for value in row] for row in self.rows)
        return text.getvalue()

    def save(self, stem: Path | str) -> tuple[Path, ...]:
        """Write stem.png, stem.svg, stem.csv and stem.txt (the caption), all of them or none.

        Returns:
            The four paths.

        Raises:
            OutputError: If one of them cannot be written.
        """
        contents = {
            ".png": self.png(),
            ".svg": self.svg(),
            ".csv": self.csv().encode(),
            ".txt": (self.caption + "\n").encode(),
        }
        paths = {end: Path(f"{stem}{end}") for end in contents}
        with contextlib.ExitStack() as stack:
            # All four are on the disk before the first one is renamed.
            for end, content in contents.items():
                stack.enter_context(whole_file(paths[end])).write_bytes(content)
        return tuple(paths.values())

    def _bytes(self, kind: str, dots_per_inch: float | None, metadata: dict[str, Any]) -> bytes:
        buffer = io.BytesIO()
        with styled():
            self.figure.savefig(
                buffer, format=kind, dpi=dots_per_inch or SETTINGS["savefig.dpi"], metadata=metadata
            )
        return buffer.getvalue()


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Apply the style's settings within a block, and restore the caller's after it."""
    import matplotlib as mpl

    # The user's settings file is ignored, and so is the backend: reading it imports pyplot.
    defaults: Any = {k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")}
    with mpl.rc_context(defaults | dict(SETTINGS)):
        yield


def new_figure(
    width: float = 5.2, height: float = 3.6, columns: int = 1
) -> tuple[Figure, NDArray[Any]]:
    """Make a figure with `columns` axes side by side, in inches.  Call it inside `styled()`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False)[0]


def long_table(series: Sequence[Series]) -> list[tuple[Any, ...]]:
    """Rows (series, x, y, low, high) of all series, with empty cells where there are no bounds.

    Example:
        >>> long_table([Series("bem", [1], [2])])
        [('bem', 1.0, 2.0, '', '')]
    """
    rows: list[tuple[Any, ...]] = []
    for item in series:
        columns = [
            [""] * item.x.size if column is None else column.tolist()
            for column in (item.x, item.y, item.low, item.high)
        ]
        rows += [(item.name, *row) for row in zip(*columns, strict=True)]
    return rows


def draw(
    axes: Any,
    series: Sequence[Series],
    *,
    labels: Mapping[str, str] | None = None,
    colours: Mapping[str, str] | None = None,
    positive: bool = False,
) -> None:
    """Draw the series, each with its own look.

    Args:
        axes: Axes of matplotlib.
        series: The series to draw.
        labels: Entries of the legend by series, if they differ from the names.
        colours: Colours by series, if they differ from the usual ones.
        positive: Leave out values that a logarithmic axis cannot show.

    Raises:
        ValueError: If no series has a value that can be drawn.
    """
    shown = 0
    looks = series_looks([item.name for item in series], [item.line for item in series])
    for item, look in zip(series, looks, strict=True):
        x, y = item.x, item.y
        good = np.isfinite(x) & np.isfinite(y)
        if positive:
            good &= y > 0
        shown += int(good.sum())
        look["color"] = (colours or {}).get(item.name, look["color"])
        if not item.line and x.size > 25:
            look["markersize"] = 3.0
        label = (labels or {}).get(item.name, item.name)
        axes.plot(x[good], y[good], label=label, **look)
        if item.low is not None and item.high is not None:
            low, high = item.low[good], item.high[good]
            if item.line:
                axes.fill_between(x[good], low, high, color=look["color"], alpha=0.2, linewidth=0)
            else:
                axes.vlines(x[good], low, high, color=look["color"], linewidth=0.9)
    if not shown:
        raise ValueError("there is nothing to draw: no series has a finite point")


def logarithmic(axes: Any, name: str) -> None:
    """Make the axis called `name` ("x" or "y") logarithmic; call it once the data are drawn.

    It has ticks at 1, 2 and 5 on a short range and at decades otherwise, because the labels of all
    minor ticks would overlap.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set(**{f"{name}scale": "log"})
    axis = getattr(axes, f"{name}axis")
    low, high = axis.get_view_interval()
    axis.set_minor_formatter(NullFormatter())
    if high < 200 * low:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(_tick))


def _tick(value: float, _: object) -> str:
    if 0.01 <= value < 1e4:
        return f"{value:g}"
    power = math.floor(math.log10(value) + 1e-9)
    factor = f"{value / 10**power:g}"
    return rf"$10^{{{power}}}$" if factor == "1" else rf"${factor}\times10^{{{power}}}$"


def zeros_at_the_bottom(axes: Any, series: Sequence[Series]) -> None:
    """Draw open marks on the lower edge of a logarithmic axis for values that are exactly zero."""
    floor = axes.get_ylim()[0]
    looks = series_looks([item.name for item in series], [item.line for item in series])
    for item, look in zip(series, looks, strict=True):
        x, y = item.x, item.y
        if np.any(y == 0):
            look["linestyle"] = "none"
            axes.plot(
                x[y == 0],
                np.full(int((y == 0).sum()), floor),
                fillstyle="none",
                clip_on=False,
                **look,
            )
            axes.set_ylim(bottom=floor)


def mark_upright(axes: Any, x: float, label: str, *, left: bool = False) -> None:
    """Draw a dotted line at `x`, with its label at the top, to the right or to the left of it."""
    axes.axvline(x, color="#7f7f7f", linewidth=0.9, linestyle=":")
    axes.annotate(
        f"{label} " if left else f" {label}",
        (x, 0.985),
        xycoords=("data", "axes fraction"),
        va="top",
        ha="right" if left else "left",
        color="#555555",
    )


def outside_legend(axes: Any) -> None:
    """Put the legend beside the axes, where it can cover no point."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def _cell(value: Any) -> Any:
    return repr(float(value)) if isinstance(value, float) else value
