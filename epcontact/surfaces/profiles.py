"""Lines of heights from lists of x and height, as stylus instruments write them.

A table of two or three columns lists the points of a profile if one column increases
or decreases from row to row.  Even steps of x are recognised within the digits of the
file.  Uneven steps are replaced by even ones by linear interpolation, and a note says
how.  A cubic spline gives other heights at the same places: twice the difference of the
results on both covers the errors of the interpolation (`python -m
laboratory.measured_maps profiles` prints how many).
"""

from __future__ import annotations

import numpy as np

from epcontact.results import FloatArray
from epcontact.surfaces.height_map import HeightMap, grid_indices

#: Fewest points of a profile; a smaller table of two columns is a map.
FEWEST = 4
#: Fraction of the steps of x that must go forward: an encoder may step back by noise.
_FORWARD = 0.9
#: Distance of a coordinate from even steps, over the step, that counts as none.
_UNEVEN = 0.01
#: Largest distance of a rounded coordinate from even steps, over its last digit: half
#: a digit, and half of this for the error of the steps that are fitted.
_ROUNDED = 0.75
#: Steps of the even grid in a gap of x from which on the heights within are missing.
_GAP = 5.0
#: Coordinates from here on are none: differences and squares of them overflow.
_LARGEST = 1e100
#: Most digits behind the decimal point that a file is expected to write.
_DIGITS = 15


def profile_columns(table: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return x and height of the points that a table lists, or None if it lists none.

    The columns are x and height; the number of the point, x and height; or x, y and
    height of a straight line along x or y.

    Args:
        table: the numbers of a file, (rows, columns), NaN for empty cells.
    """
    rows, columns = table.shape
    if rows == 2 and columns >= FEWEST:
        return profile_columns(table.T)
    if rows < FEWEST or columns not in (2, 3):
        return None
    heights = table[:, -1]
    if columns == 2:
        candidates = [table[:, 0]]
    elif _is_numbering(table[:, 0]) or _is_constant(table[:, 0]):
        candidates = [table[:, 1]]
    elif _is_constant(table[:, 1]):
        candidates = [table[:, 0]]
    else:
        candidates = []
    for x in candidates:
        if is_coordinate(x):
            return x, heights
    return None


def is_coordinate(values: FloatArray) -> bool:
    """Return True if values go on in one direction from row to row, as an x does.

    Nine of ten steps must have this direction or be 0, and the values must differ from
    each other in at least half of the rows.

    Args:
        values: a column of a table, (n,), in any unit.
    """
    if values.size < FEWEST or not np.abs(values).max() < _LARGEST:
        return False
    steps = np.diff(values)
    forward = np.count_nonzero(steps >= 0)
    backward = np.count_nonzero(steps <= 0)
    differing = np.unique(values).size
    goes_on = bool(max(forward, backward) >= _FORWARD * steps.size)
    return goes_on and 2 * differing > values.size


def profile_map(x: FloatArray, heights: FloatArray) -> HeightMap:
    """Return the line of heights on even steps of x, with its length as its period.

    The line is as long as all of its steps, one for each point.  Where x has even steps
    the heights are those of the file, and NaN where the file leaves out a step.  Uneven
    steps: the heights are interpolated linearly, and are NaN within gaps of x that are
    wider than five steps; `HeightMap.otherwise` has those of a cubic spline.

    Args:
        x: the coordinate of each point, (n,), in any unit and order.
        heights: the height of each point, (n,), NaN where it is missing.
    """
    notes = []
    order = np.argsort(x, kind="stable")
    if not np.array_equal(order, np.arange(x.size)):
        x = x[order]
        heights = heights[order]
        notes.append("the points of the profile were put in the order of x")
    step, start = map(float, np.polyfit(np.arange(x.size), x, 1))
    distance = np.abs(x - start - step * np.arange(x.size)).max()
    otherwise = None
    if distance > max(_UNEVEN * step, _ROUNDED * _last_digit(x)):
        heights, otherwise, step, note = _with_even_steps(x, heights)
        notes.append(note)
    return HeightMap(
        heights,
        periods=(step * heights.size,),
        size_source="the x of its points",
        notes=tuple(notes),
        otherwise=otherwise,
    )


def _with_even_steps(
    x: FloatArray, heights: FloatArray
) -> tuple[FloatArray, FloatArray | None, float, str]:
    """Return heights on even steps, those of a spline, the step, and a note.

    The heights of the spline are None if no height is interpolated.  The step is in the
    unit of x.

    Args:
        x: increasing coordinates of the points, (n,), with uneven steps.
        heights: the heights of the points, (n,).
    """
    index, step = grid_indices(x)
    size = int(index.max()) + 1
    if step > 0 and np.unique(index).size == x.size and size <= 2 * x.size:
        line = np.full(size, np.nan)
        line[index] = heights
        note = f"points that the profile leaves out: {size - x.size}"
        return line, None, step, note
    positions, first = np.unique(x, return_index=True)
    # Points at one x are a wall, of which the mean height is taken.
    means = np.add.reduceat(heights, first) / np.diff(np.append(first, x.size))
    gaps = np.diff(positions)
    length = float(positions[-1] - positions[0])
    step = max(float(np.median(gaps)), length / (2 * x.size))
    size = round(length / step) + 1
    step = length / (size - 1)
    even = positions[0] + step * np.arange(size)
    line = np.interp(even, positions, means)
    place = np.clip(np.searchsorted(positions, even), 1, gaps.size) - 1
    nearest = np.minimum(even - positions[place], positions[place + 1] - even)
    line[(gaps[place] > _GAP * step) & (nearest > step / 2)] = np.nan
    note = (
        f"the steps of x are uneven, from {gaps.min():.3g} to {gaps.max():.3g} in the "
        f"file's unit; the {x.size} heights were interpolated linearly to {size} of "
        f"even steps of {step:.3g}"
    )
    before = float(np.nansum(np.diff(means) ** 2 / gaps))
    after = float(np.nansum(np.diff(line) ** 2)) / step
    if before > 0:
        change = 100 * (np.sqrt(after / before) - 1)
        note += f", which changes the rms slope by {change:.1f} %"
    note += (
        "; the change by a cubic spline in place of straight lines counts as an error "
        "of each value (missing)"
    )
    return line, _splined(even, positions, means), step, note


def _splined(
    even: FloatArray, positions: FloatArray, heights: FloatArray
) -> FloatArray:
    """Return the heights of a cubic spline, which overshoots by half a range at most.

    The range is that of the four points around a place: between two points that are
    close to each other, noise makes a spline steep.

    Args:
        even: the places of the result, (m,), in the unit of x.
        positions: the increasing coordinates of the points, (n,).
        heights: the heights of the points, (n,), NaN where missing.
    """
    from scipy.interpolate import CubicSpline  # slow to load

    measured = ~np.isnan(heights)
    positions = positions[measured]
    heights = heights[measured]
    line = CubicSpline(positions, heights)(even)
    place = np.searchsorted(positions, even)[:, None] + np.arange(-2, 2)
    around = heights[np.clip(place, 0, heights.size - 1)]
    low = around.min(axis=1)
    high = around.max(axis=1)
    overshoot = (high - low) / 2
    return np.asarray(np.clip(line, low - overshoot, high + overshoot))


def _last_digit(x: FloatArray) -> float:
    """Return the value of the last decimal digit with which a file writes coordinates.

    Args:
        x: the coordinates as read, (n,); 0 is returned if they have more digits than a
            file is expected to write.
    """
    for digits in range(_DIGITS):
        if np.array_equal(np.round(x, digits), x):
            return 10.0**-digits
    return 0.0


def _is_numbering(values: FloatArray) -> bool:
    """Return True if the values of a column, (n,), count its rows: n, n + 1, n + 2 …"""
    return bool((np.diff(values) == 1).all())


def _is_constant(values: FloatArray) -> bool:
    """Return True if all values of a column, (n,), are equal."""
    return bool((values == values[0]).all())
