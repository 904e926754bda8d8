"""A chart is a picture, its data and a caption, which are saved together or not at all.

Figures are made without pyplot, so that no window can open, and threads or a user's own
matplotlib session are not affected.  Matplotlib is imported where it is used, because
its import takes longer than most commands.
"""

from __future__ import annotations

import base64
import contextlib
import csv
import html
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from epcontact.errors import without_controls
from epcontact.files import atomic_write
from epcontact.output.charts.style import SETTINGS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A logarithmic axis that spans a smaller ratio has ticks at 1, 2 and 5, too.
_SHORT_RANGE = 200.0


@dataclass(frozen=True, repr=False)
class Chart:
    """A picture with its data and its caption.  A notebook shows the picture.

    Attributes:
        figure: a matplotlib Figure that belongs to no pyplot session.
        header: the names of the columns of the data, with their units.
        rows: the data that are drawn, one sequence for each row.
        caption: the caption, one or a few sentences.
    """

    figure: Figure
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str

    def __post_init__(self) -> None:
        """Compute the layout of the figure and fix it."""
        # The layout is computed once: repeated at every drawing it shifts, and the same
        # chart would give different bytes.
        engine = self.figure.get_layout_engine()
        if engine is not None:
            with styled():
                engine.execute(self.figure)
            self.figure.set_layout_engine("none")

    def __repr__(self) -> str:
        """Return the caption and the number of rows of the data."""
        return f"<Chart with {len(self.rows)} rows: {self.caption}>"

    def png(self) -> bytes:
        """Return the picture of this chart as the bytes of a PNG file."""
        canvas: Any = self.figure.canvas
        with styled():
            # Matplotlib's `savefig` would draw twice, the first time for the layout.
            canvas.draw()
        pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        buffer = io.BytesIO()
        dpi = self.figure.dpi
        pixels.save(buffer, "png", dpi=(dpi, dpi))
        return buffer.getvalue()

    _repr_png_ = png  # for notebooks

    def svg(self) -> bytes:
        """Return the picture of this chart as the bytes of an SVG file.

        The same data give the same bytes.
        """
        buffer = io.BytesIO()
        metadata = {"Date": None, "Creator": None}
        with styled():
            self.figure.savefig(buffer, format="svg", metadata=metadata)
        return buffer.getvalue()

    def csv(self) -> str:
        """Return the data of this chart as comma-separated text with a line of
        headings.

        Every float has all its digits.
        """
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.header, *self.rows])
        return text.getvalue()

    def save(self, stem: Path | str, vector: bool = True) -> tuple[Path, ...]:
        """Write the picture, the data and the caption of this chart to files.

        If one of the files cannot be written, none is.

        Args:
            stem: the path of the files without an ending.
            vector: whether to write the picture as an SVG file beside the PNG file.
                This takes as long as all other files.

        Returns:
            The paths stem.png, stem.svg (if `vector`), stem.csv and stem.txt (the
            caption).

        Raises:
            OutputError: if a file cannot be written.
        """
        contents = {Path(f"{stem}.png"): self.png()}
        if vector:
            contents[Path(f"{stem}.svg")] = self.svg()
        contents[Path(f"{stem}.csv")] = self.csv().encode()
        caption = without_controls(self.caption)
        contents[Path(f"{stem}.txt")] = f"{caption}\n".encode()
        with contextlib.ExitStack() as stack:
            # All four are on the disk before the first one is renamed.
            for path, content in contents.items():
                stack.enter_context(atomic_write(path)).write_bytes(content)
        return tuple(contents)


#: The files of a picture that a page may show: the small copy of a chart, or a film.
PAGE_ENDINGS = (".webp", ".gif")


class Charts(dict[str, Chart]):
    """Charts by name.  A notebook shows all pictures with their captions."""

    def _repr_html_(self) -> str:
        """Return the pictures with names and captions as HTML."""
        figures = []
        for name, chart in self.items():
            picture = base64.b64encode(chart.png()).decode()
            caption = html.escape(f"{name}: {chart.caption}")
            figures.append(
                f'<figure><img alt="{caption}" style="max-width: 45em; width: 100%" '
                f'src="data:image/png;base64,{picture}"/><figcaption>{caption}'
                "</figcaption></figure>"
            )
        return "".join(figures)


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
    """Return a context manager under which matplotlib draws with the package's style.

    The caller's settings of matplotlib are restored at its end.
    """
    import matplotlib as mpl

    # The user's settings file is ignored, and so is the backend: reading it imports
    # pyplot.
    settings: dict[Any, Any] = {
        name: value
        for name, value in mpl.rcParamsDefault.items()
        if not name.startswith("backend")
    }
    with mpl.rc_context(settings | dict(SETTINGS)):
        yield


def new_figure(
    width: float,
    height: float,
    columns: int = 1,
    layout: Literal["constrained"] | None = "constrained",
) -> tuple[Figure, NDArray[Any]]:
    """Create a figure of matplotlib with axes side by side.

    Call it inside `with styled():`, because axes take their look when they are created.

    Args:
        width, height: the size of the figure in inches.
        columns: the number of axes.
        layout: matplotlib's layout "constrained", which finds room for labels by
            drawing them several times; None: the caller places the axes.

    Returns:
        The figure and its axes, an array of shape (columns,).
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, columns, squeeze=False)[0]


def write_question(figure: Figure, question: str) -> None:
    """Write the question that a chart of several panels answers above them.

    Args:
        figure: the figure of matplotlib.
        question: a short sentence, which begins at the left edge.
    """
    with styled():
        figure.suptitle(question, x=0.01, ha="left", fontsize=10)


def logarithmic(axes: Any, name: str) -> None:
    """Make an axis logarithmic, once the data are drawn.

    It has ticks at 1, 2 and 5 on a short range and at decades otherwise, because the
    labels of all minor ticks would overlap.

    Args:
        axes: the axes of matplotlib.
        name: the axis, "x" or "y".
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set(**{f"{name}scale": "log"})
    axis = getattr(axes, f"{name}axis")
    low, high = axis.get_view_interval()
    axis.set_minor_formatter(NullFormatter())
    if high < _SHORT_RANGE * low:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(_tick_label))


def _tick_label(value: float, _: object) -> str:
    """Return the label of a tick of a logarithmic axis, as mathtext if it is a power.

    Args:
        value: the positive value at the tick.  Below 0.01 and from 10000 on, its label
            has a power of ten.
        _: the position of the tick, which matplotlib passes and which is not used.
    """
    if 0.01 <= value < 1e4:
        return f"{value:g}"
    power = math.floor(math.log10(value) + 1e-9)
    factor = f"{value / 10**power:g}"
    if factor == "1":
        return rf"$10^{{{power}}}$"
    return rf"${factor}\times10^{{{power}}}$"
