"""A chart is a picture, its data and a caption, which are saved together or not at all.

Figures are made without pyplot, so that no window can open, and threads or a user's own
matplotlib session are not affected.  Matplotlib is imported where it is used, because
its import takes longer than most commands.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from epcontact.files import atomic_write
from epcontact.output.charts.style import SETTINGS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Chart:
    """A picture (a matplotlib Figure of no pyplot session) with its data and its
    caption.
    """

    figure: Figure
    header: Sequence[str]  # names of the columns, with their units
    rows: Sequence[Sequence[Any]]  # the data that are drawn
    caption: str

    def __post_init__(self) -> None:
        # The layout is computed once: repeated at every drawing it shifts, and the same
        # chart would give different bytes.
        with styled():
            self.figure.draw_without_rendering()
            self.figure.set_layout_engine("none")

    def png(self) -> bytes:
        """The picture as PNG."""
        return self._bytes("png", {"Software": None})

    _repr_png_ = png  # for notebooks

    def svg(self) -> bytes:
        """The picture as SVG: the same bytes for the same data."""
        return self._bytes("svg", {"Date": None, "Creator": None})

    def csv(self) -> str:
        """The data as comma-separated values, every float with all its digits."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.header, *self.rows])
        return text.getvalue()

    def save(self, stem: Path | str) -> tuple[Path, ...]:
        """Write stem.png, stem.svg, stem.csv and stem.txt (the caption), or raise
        OutputError.  If one of them cannot be written, none is.
        """
        contents = {".png": self.png(), ".svg": self.svg(), ".csv": self.csv().encode()}
        contents[".txt"] = f"{self.caption}\n".encode()
        paths = [Path(f"{stem}{end}") for end in contents]
        with contextlib.ExitStack() as stack:
            # All four are on the disk before the first one is renamed.
            for path, content in zip(paths, contents.values(), strict=True):
                stack.enter_context(atomic_write(path)).write_bytes(content)
        return tuple(paths)

    def _bytes(self, kind: str, metadata: dict[str, Any]) -> bytes:
        buffer, dots = io.BytesIO(), SETTINGS["savefig.dpi"]
        with styled():
            self.figure.savefig(buffer, format=kind, dpi=dots, metadata=metadata)
        return buffer.getvalue()


class Pictures(NamedTuple):
    """The pictures of a case's results in its folder.

    Attributes:
        names: the names of the files without their endings.  Each picture has a caption
            (.txt) beside it.
        missing: a sentence for each picture that could not be drawn.
    """

    names: Sequence[str]
    missing: Sequence[str] = ()


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Apply the style's settings within a block, and restore the caller's after it."""
    import matplotlib as mpl

    # The user's settings file is ignored, and so is the backend: reading it imports
    # pyplot.
    defaults: Any = {
        k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")
    }
    with mpl.rc_context(defaults | dict(SETTINGS)):
        yield


def new_figure(
    width: float, height: float, columns: int = 1
) -> tuple[Figure, NDArray[Any]]:
    """Make a figure with `columns` axes side by side, in inches.  Call it inside
    `styled()`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False)[0]


def logarithmic(axes: Any, name: str) -> None:
    """Make the axis called `name` ("x" or "y") logarithmic; call it once the data are
    drawn.  It has ticks at 1, 2 and 5 on a short range and at decades otherwise,
    because the labels of all minor ticks would overlap.
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
