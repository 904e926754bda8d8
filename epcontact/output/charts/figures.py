"""A chart: picture, data and caption, saved together, whole or not at all.

Figures are made without pyplot: nothing is registered anywhere, no window can open, and threads
or a user's own matplotlib session are left alone.
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

    x, y: array-likes of equal length, kept as float64 arrays; values that are not finite are
        left out of the picture.
    low, high: bounds of y, drawn as error bars (points) or as a band (lines).
    line: a curve without marks (theory) rather than points.
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
    """A picture that can stand alone.

    figure: a matplotlib Figure that belongs to no pyplot session.
    header, rows: the data behind it, units in the header.
    caption: sentences that say what is seen, with the parameters.
    """

    figure: Figure
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str

    def __post_init__(self) -> None:
        # The layout is found once and kept: found again at every drawing, it creeps, and the
        # same chart would give other bytes.
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

        Raises OutputError if one cannot be written.
        """
        contents = {
            ".png": self.png(),
            ".svg": self.svg(),
            ".csv": self.csv().encode(),
            ".txt": (self.caption + "\n").encode(),
        }
        paths = {end: Path(f"{stem}{end}") for end in contents}
        with contextlib.ExitStack() as stack:
            # All are on the disk before the first one takes its place.
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
    """The style's settings for the length of a block; those of the caller come back after it."""
    import matplotlib as mpl

    # Not the user's own settings file, and not the backend: asking for it imports pyplot.
    defaults: Any = {k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")}
    with mpl.rc_context(defaults | dict(SETTINGS)):
        yield


def new_figure(
    width: float = 5.2, height: float = 3.6, columns: int = 1
) -> tuple[Figure, NDArray[Any]]:
    """A figure of `columns` axes side by side (sizes in inches); call it inside `styled()`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False)[0]


def long_table(series: Sequence[Series]) -> list[tuple[Any, ...]]:
    """Rows (series, x, y, low, high) of all series; empty cells where there are no bounds."""
    rows: list[tuple[Any, ...]] = []
    for one in series:
        columns = [
            [""] * one.x.size if column is None else column.tolist()
            for column in (one.x, one.y, one.low, one.high)
        ]
        rows += [(one.name, *row) for row in zip(*columns, strict=True)]
    return rows


def draw(
    axes: Any,
    series: Sequence[Series],
    *,
    labels: Mapping[str, str] | None = None,
    colours: Mapping[str, str] | None = None,
    positive: bool = False,
) -> None:
    """Draw the series with their looks; values that cannot be shown are left out."""
    shown = 0
    looks = series_looks([one.name for one in series], [one.line for one in series])
    for one, look in zip(series, looks, strict=True):
        x, y = one.x, one.y
        good = np.isfinite(x) & np.isfinite(y)
        if positive:
            good &= y > 0
        shown += int(good.sum())
        look["color"] = (colours or {}).get(one.name, look["color"])
        if not one.line and x.size > 25:
            look["markersize"] = 3.0
        label = (labels or {}).get(one.name, one.name)
        axes.plot(x[good], y[good], label=label, **look)
        if one.low is not None and one.high is not None:
            low, high = one.low[good], one.high[good]
            if one.line:
                axes.fill_between(x[good], low, high, color=look["color"], alpha=0.2, linewidth=0)
            else:
                axes.vlines(x[good], low, high, color=look["color"], linewidth=0.9)
    if not shown:
        raise ValueError("there is nothing to draw: no series has a finite point")


def logarithmic(axes: Any, name: str) -> None:
    """Make the axis called `name` ("x" or "y") logarithmic; call it once the data are drawn.

    Ticks stand at 1, 2 and 5 where it spans little, at whole decades elsewhere: labels of every
    minor tick would overlap.
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
    """Open marks on the lower edge of a logarithmic axis for values that are exactly zero."""
    floor = axes.get_ylim()[0]
    looks = series_looks([one.name for one in series], [one.line for one in series])
    for one, look in zip(series, looks, strict=True):
        x, y = one.x, one.y
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


def outside_legend(axes: Any) -> None:
    """Beside the axes, where it can cover no point."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def _cell(value: Any) -> Any:
    return repr(float(value)) if isinstance(value, float) else value
