"""Fields as images with averaged colours, so that a large field makes a small picture.

matplotlib is imported where it is used, because its import takes longer than most commands.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.output.charts.style import STATE_COLOURS, unit_for
from epcontact.results import APART, ELASTIC, PLASTIC

#: Pixels along the longer side of a field's picture; more points are averaged in colour.
PIXELS = 800


def show_field(
    axes: Any,
    field: NDArray[Any],
    spacing: tuple[float, ...],
    paint: Callable[[NDArray[Any]], NDArray[Any]],
) -> None:
    """Draw a field (nx, ny), x to the right and y upward, in the colours that `paint` gives."""
    periods = [n * d for n, d in zip(field.shape, spacing, strict=True)]
    scale, unit = unit_for(max(periods), "m")
    # The first grid point is at the origin; each point is the centre of its pixel.
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
    """Return the colours of a field, averaged to at most `pixels` along a side.

    Colours are averaged, not values, because a state has no mean and a thin contact must remain
    visible.  The rows are painted a few at a time, so that a large field needs no more
    memory than the picture.

    Args:
        field: Values of shape (nx, ny).
        paint: Maps values of any shape to colours of that shape and three or four channels.
        pixels: Most pixels along a side.

    Returns:
        Red, green and blue from 0 to 1, of shape (mx, my, 3).

    Example:
        >>> shrunk(np.array([[0.0, 1.0]]), lambda v: np.repeat(v[..., None], 3, axis=2), 1)
        array([[[0.5, 0.5, 0.5]]], dtype=float32)
    """
    edges = [np.linspace(0, n, min(n, pixels) + 1).astype(np.intp) for n in field.shape]
    picture = np.empty((edges[0].size - 1, edges[1].size - 1, 3), dtype=np.float32)
    widths = np.diff(edges[1])[:, None]
    for i, (start, stop) in enumerate(zip(edges[0], edges[0][1:], strict=False)):
        colours = paint(np.asarray(field[start:stop]))[..., :3].mean(axis=0)
        picture[i] = np.add.reduceat(colours, edges[1][:-1], axis=0) / widths
    return picture


def paint_states(states: NDArray[Any]) -> NDArray[Any]:
    """The colours of contact states, with three channels."""
    from matplotlib.colors import to_rgb

    table = np.array([to_rgb(STATE_COLOURS[kind]) for kind in (APART, ELASTIC, PLASTIC)])
    return table[np.asarray(states, dtype=np.intp)]


def colour_bar(
    name: str, low: float, high: float, scale: float, *, blank: bool = False
) -> tuple[Any, Callable[[NDArray[Any]], NDArray[Any]]]:
    """Return the colours between two limits.

    Args:
        name: Name of a colour map.
        low, high: Limits, in the unit of the colour bar.
        scale: Divides the values to give them that unit.
        blank: Leave values of zero white.

    Returns:
        The mappable of a colour bar, and the function that paints values.
    """
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
