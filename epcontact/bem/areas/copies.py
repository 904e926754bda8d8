"""Copies of one cell on a grid, whose areas have the same errors."""

from __future__ import annotations

import math

import numpy as np

from epcontact.results import FloatArray

#: Pressures that differ by less than this share of their range are taken for copies.  Of a texture
#: with a roughness of up to a hundredth of its height they do, and the errors are alike.
CLOSE = 0.2


def copies(pressure: FloatArray) -> int:
    """Count the copies of one cell that a periodic grid (nx, ny) holds, whole points apart."""
    row, column = np.unravel_index(pressure.argmax(), pressure.shape)
    close = CLOSE * float(pressure[row, column] - pressure.min())
    along_x, along_y = _times(pressure, int(row), close), _times(pressure.T, int(column), close)
    cell = pressure[: pressure.shape[0] // along_x, : pressure.shape[1] // along_y]
    place = int(row) % cell.shape[0], int(column) % cell.shape[1]
    return along_x * along_y * _oblique(cell, place, close)


def _oblique(cell: FloatArray, highest: tuple[int, int], close: float) -> int:
    """Count the copies in a cell that are one step along both axes apart, as in a hexagon."""
    (nx, ny), (row, column) = cell.shape, highest
    # Points from the highest on, one and more, rule out the steps of most surfaces without copies.
    some = (column + np.arange(0, ny, max(ny // 16, 1))) % ny
    for count in range(math.gcd(nx, ny), 1, -1):
        if nx % count == ny % count == 0:
            steps, moved = np.arange(1, count) * (ny // count), cell[(row + nx // count) % nx]
            for part in (some[:1], some):
                off = np.abs(moved[(part + steps[:, None]) % ny] - cell[row, part])
                steps = steps[(off <= close).all(axis=1)]
            if any(_repeats(cell, row, count, (nx // count, int(step)), close) for step in steps):
                return count
    return 1


def _times(values: FloatArray, first: int, close: float) -> int:
    """Count how often the rows of a periodic grid repeat, one prime factor after another."""
    n, rest, factor = len(values), len(values), 2
    while rest > 1:
        if rest % factor:
            factor += 1
        elif _repeats(values[:n], first % n, factor, (n // factor, 0), close):
            n, rest = n // factor, rest // factor
        else:
            while rest % factor == 0:
                rest //= factor
    return len(values) // n


def _repeats(
    values: FloatArray, first: int, count: int, step: tuple[int, int], close: float
) -> bool:
    """True if values on a periodic grid are `count` copies, to `close`, one step from the next.

    first: a row of the highest values, where surfaces without copies differ at once, at least in
    several steps.
    """
    n, few = len(values), 8
    steps = sorted({count // part for part in range(2, count + 1)}, reverse=True)
    return all(
        np.abs(values[i % n] - np.roll(values[(i + k * step[0]) % n], -k * step[1], 1)).max()
        <= close
        for k in steps
        for i in (first + np.arange(start, min(start + few, n)) for start in range(0, n, few))
    )
