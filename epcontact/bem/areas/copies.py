"""Copies of one cell on a grid, whose areas have the same errors."""

from __future__ import annotations

import numpy as np

from epcontact.results import FloatArray

#: Pressures that differ by less than this share of their range are taken for copies.  On a texture
#: with a roughness of up to a hundredth of its height they do, and the errors are still alike; with
#: one of three hundredths neither is so.
CLOSE = 0.2


def copies(pressure: FloatArray) -> int:
    """How many copies of one cell a periodic grid (nx, ny) holds at whole numbers of points.

    The grid meets all of them alike, so that their errors are the same.  Copies along the rows and
    columns count, and a second one in the middle of the cell; those of other lattices do not.

    Example:
        >>> copies(np.tile(np.eye(2), (4, 3)))
        24
    """
    row, column = np.unravel_index(pressure.argmax(), pressure.shape)
    close = CLOSE * float(pressure[row, column] - pressure.min())
    along_x, along_y = _times(pressure, int(row), close), _times(pressure.T, int(column), close)
    nx, ny = pressure.shape[0] // along_x, pressure.shape[1] // along_y
    cell = pressure[:nx, :ny]
    centred = nx % 2 == ny % 2 == 0 and _repeats(cell, int(row) % nx, (nx // 2, ny // 2), close)
    return along_x * along_y * (1 + centred)


def _times(values: FloatArray, first: int, close: float) -> int:
    """How many times the rows of a periodic grid repeat, by one prime factor after another."""
    n, rest, factor = len(values), len(values), 2
    while rest > 1:
        if rest % factor:
            factor += 1
        elif _repeats(values[:n], first % n, (n // factor, 0), close):
            n, rest = n // factor, rest // factor
        else:
            while rest % factor == 0:
                rest //= factor
    return len(values) // n


def _repeats(values: FloatArray, first: int, shift: tuple[int, int], close: float) -> bool:
    """Whether values on a periodic grid repeat after a shift of rows and columns, to `close`.

    first: a row of the highest values.  Surfaces without copies differ there at once.
    """
    n, few = len(values), 8
    return all(
        np.abs(values[i % n] - np.roll(values[(i + shift[0]) % n], -shift[1], 1)).max() <= close
        for i in (first + np.arange(start, min(start + few, n)) for start in range(0, n, few))
    )
