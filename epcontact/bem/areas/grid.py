"""What the fronts of a contact on a periodic grid enclose: sums over its cells.

All that is needed of a point is v = p - c g: at most 0 where apart, at least the
hardness where plastic.  c is STIFFNESS E*/dx for links along x and, on oblong cells,
STIFFNESS E*/dy for links along y; so oblong cells have two layers of v.  A front
crosses links between neighbouring points, where `front` locates it.  Straight segments
between the two crossings of a cell bound the area.

Front 0 bounds the contact.  Front 1 bounds its plastic part: it is the front 0 of the
mirror image, hardness - v, in which plastic points are apart.  A cell is named after
its last corner, point (i, j).  Its corners 0 to 3 are (i - 1, j - 1), (i, j - 1), (i,
j) and (i - 1, j), and its side k runs from corner k to the next.

For each block of cells and each front there are five passes:

1. `_list_cells` lists the cells that the front crosses and the elastic points;
2. `_number_links` numbers the links that the front crosses, so that neighbouring cells
   share a link, and copies the six values of v around each;
3. `front.locate` and `front.locate_special` find the positions on the links;
4. `_add_segments` adds the segments in the cells, and narrow tips, to the sums;
5. `_add_hidden` adds what elastic points may hide.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import (
    FLOWED,
    ROWS,
    TOP,
    UNLOADED,
    Links,
    locate,
    locate_special,
    released_width,
    strip_width,
)
from epcontact.bem.areas.hidden import crease_gap, inlined, wedge_width
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

#: Width of the elastic strip beside a front, in spacings, and the offset of a located
#: front there (`laboratory.rim.calibrate_strips`).  The last offset is that of a front
#: alone (`calibrate_directions`).
WIDTHS = np.array([0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.65, 2.2])
OFFSETS = np.array(
    [0, 0.072, 0.1367, 0.1913, 0.22, 0.2244, 0.2164, 0.1981, 0.1753, 0.1706, 0.1786]
)
#: Along a crease, and from copy to copy, pressures change by less than this fraction of
#: their change across the crease, or of their range (chosen on `laboratory.area_bank`).
ALIKE = 0.2
#: Cells that a spot lacks because its front is curved (`calibrate_corner`).
CORNER = 0.6
#: Standard deviation, in spacings, of the position of strips narrower than a spacing
#: (chosen on `laboratory.area_bank`).
NARROW = 0.22
#: Points around the cells of a block that are read, too.
PAD = 4
_FINE = 500  # entries for a spacing in the interpolated table of offsets
# The corner that a front cuts off, or the first of two on the same side of it, by the
# sum of 2^k over the corners k inside.
_CUT = np.array([0, 0, 1, 0, 2, 0, 1, 3, 3, 1, 1, 2, 0, 1, 0, 0])
# Bits of a cell's code: 2^k for each corner k on the other side of the front than the
# last corner, one where that corner is elastic, and one for cells before the block,
# which share links with its cells.
_CORNERS = 15
_ELASTIC = 16
_BEFORE = 32


class Solution(NamedTuple):
    """A solution on a periodic grid.

    Attributes:
        pressure, gap: (nx, ny) in Pa and m.
        hardness: least pressure of a plastic point, in Pa; infinite if none can be.
        stiffness: c for links along x and along y, in Pa/m.
        earlier_flow: (nx, ny) plastic displacement of earlier loads in m; (0, 0) if
            there was none.
        earlier_hardness: hardness of that flow in Pa.
    """

    pressure: FloatArray
    gap: FloatArray
    hardness: float
    stiffness: tuple[float, float]
    earlier_flow: FloatArray
    earlier_hardness: float


class Sums(NamedTuple):
    """Sums over the fronts around the contact and around its plastic part: (..., 2).

    Lengths are in spacings and areas in cells.  "Free" lengths are not held by an edge
    of the surface.  Where the elastic strip beside a front is u = hardness/|grad v| < 1
    spacings wide, the two fronts move together, and only the fraction u^2 of the length
    counts as this front's own.

    Attributes:
        points: points inside the front.
        tips: narrow tips, weighted (`_tip`).
        gap_squares: squares of gaps that no point shows (`_add_hidden`).
        crease_area: area of gaps at creases that no point shows.
        area: area inside the located front.
        offset: free length times the offset for the width of the strip there.
        offset_cos, offset_sin: the same times cos 4 theta and sin 4 theta, with theta
            the direction of the front.
        turn: a quarter for each corner cut off; for a closed front its Euler number.
        hidden_zone: length times the width of the plastic zone hidden at edges.
        released: length times the width that has come off flattened spots.
        length: own length.
        shared: length that is not its own.
        pinned: own length held by edges.
        at_kink: own length at kinks.
        uncertainty: own free length times the uncertainty of the position.
        scatter: own free length times the variance of the position.
    """

    points: FloatArray
    tips: FloatArray
    gap_squares: FloatArray
    crease_area: FloatArray
    area: FloatArray
    offset: FloatArray
    offset_cos: FloatArray
    offset_sin: FloatArray
    turn: FloatArray
    hidden_zone: FloatArray
    released: FloatArray
    length: FloatArray
    shared: FloatArray
    pinned: FloatArray
    at_kink: FloatArray
    uncertainty: FloatArray
    scatter: FloatArray


class _Grid(NamedTuple):
    """The points of a block and PAD more on each side, row by row.

    Attributes:
        unit, columns, layer: steps to the next point, to the next row, and from v for
            links along x to v for links along y.
        v: (layers * points,) p - c g.
        state: (points,) 0 where apart, 1 where elastic, 2 where plastic.
        lowered: c times the earlier flow, as v; of size 0 if there was none.
    """

    unit: np.uint64
    columns: np.uint64
    layer: np.uint64
    v: FloatArray
    state: NDArray[np.uint8]
    lowered: FloatArray


class _Cells(NamedTuple):
    """The cells of a block, whose numbers are those of their last corners.

    Attributes:
        codes: (points,) code of each cell, as described at _CORNERS.
        words: the same, eight codes at once.
        crossed: numbers of the cells that the front crosses.
        elastic: numbers of the elastic points.
        link_x, link_y: (points,) number of the link from the last corner to the point
            before it along x and along y, if the front crosses it.
    """

    codes: NDArray[np.uint8]
    words: NDArray[np.uint64]
    crossed: NDArray[np.uint32]
    elastic: NDArray[np.uint32]
    link_x: NDArray[np.uint32]
    link_y: NDArray[np.uint32]


def sweep(solution: Solution, blocks: NDArray[np.int64], offsets: FloatArray) -> Any:
    """Return sums over the fronts in blocks of cells of a periodic grid.

    A front is the line around the contact, or around its plastic part.  A cell is the
    square between four neighbouring points.

    Args:
        solution: pressure and gap on the grid.
        blocks: (n, 4) first row, row after the last, first column, column after the
            last of each block.
        offsets: (len(WIDTHS),) how far a located front lies outside the front in the
            continuum, in spacings, by the width of the elastic strip beside it.

    Returns:
        A structured array (n, 2) with the fields of `Sums`: for each block, the sums
        around the contact and those around its plastic part.
    """
    sizes = blocks[:, 1::2] - blocks[:, ::2]
    layers = len({*solution.stiffness})
    rows, columns = sizes.max(axis=0) + 2 * PAD
    columns = -(-columns // 8) * 8  # whole words of codes
    points = rows * columns
    has_flowed = solution.earlier_flow.size > 0
    grid = _Grid(
        np.uint64(1),
        np.uint64(columns),
        np.uint64((layers - 1) * points),
        np.zeros(layers * points),
        np.zeros(points, np.uint8),
        np.zeros(layers * points if has_flowed else 0),
    )
    codes = np.zeros(points, np.uint8)
    numbers = np.empty((4, points), np.uint32)
    cells = _Cells(codes, codes.view(np.uint64), *numbers)
    entries = np.arange(round(WIDTHS[-1] * _FINE) + 1) / _FINE
    table = np.interp(entries, WIDTHS, offsets)
    hardness = solution.hardness
    limits = (hardness, solution.earlier_hardness)
    found = np.zeros((len(blocks), 2), [(name, float) for name in Sums._fields])
    for block, sums in zip(blocks, found, strict=True):
        _fill(grid, solution, block)
        for front in range(2 if hardness < np.inf else 1):
            if front == 1:  # the mirror image, which has not flowed before
                np.subtract(hardness, grid.v, grid.v)
                np.subtract(2, grid.state, grid.state)
                grid.lowered[:] = 0.0
            of_front = sums[front : front + 1]
            inside, crossed, elastic = _list_cells(grid, cells, block)
            of_front["points"] = inside
            # A crossed cell has at most two links of its own.
            values = np.empty((ROWS, 2 * crossed))
            links = Links(*np.empty((len(Links._fields), 2 * crossed)))
            count = _number_links(grid, cells, crossed, limits, values)
            locate(values, count, hardness, links)
            locate_special(values, count, hardness, links)
            _add_segments(grid, cells, crossed, links, limits, table, of_front)
            _add_hidden(grid, cells.elastic, elastic, hardness, of_front)
    if hardness < np.inf:  # inside the plastic front is outside its mirror image
        found["points"][:, 1] = sizes.prod(axis=1) - found["points"][:, 1]
        found["area"][:, 1] *= -1
        found["turn"][:, 1] *= -1
    found["area"] += found["points"]
    return found


@compiled
def _fill(grid: Any, solution: Solution, block: NDArray[np.int64]) -> None:
    """Overwrite the grid with the points of a block and PAD points around it.

    grid: a `_Grid`, filled with v (the pressure minus the stiffness times the gap), the
    states and the earlier flow; solution: a `Solution`, which is periodic; block: (4,)
    first row, row after the last, first column, column after the last.
    """
    pressure, gap, hardness, stiffness, flow, _ = solution
    first, last, left, right = block
    nx, ny = pressure.shape
    points = len(grid.state)
    wide = right - left + 2 * PAD
    for i in range(last - first + 2 * PAD):
        row = (first - PAD + i) % nx
        done = 0
        while done < wide:  # from one end of the period to the next
            start = (left - PAD + done) % ny
            stop = min(ny, start + wide - done)
            at = i * np.int64(grid.columns) + done
            p = pressure[row, start:stop]
            g = gap[row, start:stop]
            state = grid.state[at:]
            for layer in range(len(grid.v) // points):
                c = stiffness[layer]
                v = grid.v[layer * points + at :]
                for j in range(stop - start):
                    depth = 0.0
                    if p[j] <= 0:
                        depth = max(g[j], 0.0)
                    elif p[j] >= hardness:
                        depth = min(g[j], 0.0)
                    v[j] = min(max(p[j], 0.0), hardness) - c * depth
                    state[j] = (p[j] > 0) + (p[j] >= hardness)
                if flow.size:
                    lowered = grid.lowered[layer * points + at :]
                    for j in range(stop - start):  # not of what flows again
                        lowered[j] = c * flow[row, start + j] * (p[j] < hardness)
            done += stop - start


@compiled
def _list_cells(
    grid: Any, cells: Any, block: NDArray[np.int64]
) -> tuple[int, int, int]:
    """List the cells of a block that the front crosses, and its elastic points.

    The front separates points whose state is 0 from the others.  The lists include a
    row and a column of cells before the block.

    grid: the `_Grid` of the block; cells: the `_Cells` whose codes and lists are
    overwritten; block: (4,) first row, row after the last, first column, column after
    the last.

    Returns the number of points inside the front, of crossed cells and of elastic
    points.
    """
    first, last, left, right = block
    columns = np.int64(grid.columns)
    inside = crossed = elastic = 0
    for i in range(PAD - 1, PAD + last - first):
        row = i * columns
        start = row + PAD - 1
        stop = row + PAD + right - left
        # Of slices, the compiler makes loops over vectors.
        code = cells.codes[start:stop]
        corner_0 = grid.state[start - columns - 1 :]
        corner_1 = grid.state[start - 1 :]
        corner_2 = grid.state[start:]
        corner_3 = grid.state[start - columns :]
        before = _BEFORE * (i < PAD)
        for j in range(len(code)):
            is_inside = corner_2[j] > 0
            corners = (
                (corner_0[j] > 0) ^ is_inside
                | ((corner_1[j] > 0) ^ is_inside) << 1
                | ((corner_3[j] > 0) ^ is_inside) << 3
            )
            code[j] = corners | (corner_2[j] & 1) << 4 | before
        code[0] |= _BEFORE
        cells.codes[stop : row + columns] = 0
        if not before:
            for j in range(1, len(code)):
                inside += corner_2[j] > 0
        for word in range(row // 8, (row + columns) // 8):
            if cells.words[word]:
                # Without branches, which the processor could not foresee.
                for k in range(8 * word, 8 * word + 8):
                    cells.crossed[np.uint64(crossed)] = k
                    cells.elastic[np.uint64(elastic)] = k
                    crossed += cells.codes[k] & _CORNERS > 0
                    elastic += cells.codes[k] & (_ELASTIC | _BEFORE) == _ELASTIC
    return inside, crossed, elastic


@compiled
def _number_links(
    grid: Any, cells: Any, count: int, limits: tuple[float, float], values: Any
) -> int:
    """Number the links that a front crosses, and return the number of links.

    A link joins two neighbouring points on both sides of the front.

    grid: the `_Grid` of a block; cells: its `_Cells`, whose link_x and link_y are
    written; count: number of crossed cells; limits: hardness in Pa now and under the
    earlier loads; values: (front.ROWS, n) that is filled with the values in Pa around
    each link.
    """
    columns = np.int64(grid.columns)
    layer = np.int64(grid.layer)
    links = 0
    for cell in cells.crossed[:count]:
        point = np.int64(cell)
        code = cells.codes[point]
        if code & 8:  # corner 3 is on the other side
            cells.link_x[point] = links
            _copy_link(grid, point, columns, point, limits, values, links)
            links += 1
        if code & 2:  # corner 1 is on the other side
            cells.link_y[point] = links
            _copy_link(grid, point, 1, point + layer, limits, values, links)
            links += 1
    return links


@inlined
def _copy_link(
    grid: Any,
    point: int,
    step: int,
    at: int,
    limits: tuple[float, float],
    values: Any,
    link: int,
) -> None:
    """Write the values around one link to the column `link` of `values`.

    Six points along the axis of the link are copied from inside the front to outside;
    the third is the last point inside.

    grid: the `_Grid` of a block; point: number of the end of the link that is farther
    along the axis; step: difference of the numbers of neighbouring points along the
    axis; at: index in `grid.v` of the point; limits: hardness in Pa now and under the
    earlier loads; values: (front.ROWS, n) in Pa; link: number of the link.
    """
    hardness, earlier_hardness = limits
    if grid.state[point] > 0:
        start = at + 2 * step
        step = -step
    else:
        start = at - 3 * step
    for j in range(6):
        values[j, link] = grid.v[np.uint64(start + j * step)]
    values[FLOWED, link] = 0.0
    values[UNLOADED, link] = 0.0
    values[TOP, link] = hardness
    if len(grid.lowered):
        _restore_peak(values[:, link], grid.lowered, start, step, earlier_hardness)


@inlined
def _restore_peak(
    link: Any, lowered: FloatArray, start: Any, step: Any, hardness: float
) -> None:
    """Write how the points of a link flowed under earlier loads, in place.

    If the link is at the edge of a flattened spot (points that flowed under an earlier,
    larger load), the values are changed to those at that peak load.

    link: (front.ROWS,) values in Pa around the link; lowered: earlier plastic
    displacement of all points, as a pressure in Pa; start, step: index of the first of
    six points in `lowered`, and the step to the next; hardness: in Pa, of that flow.

    At the edge of a flattened spot the pressure falls from the hardness to 0 within
    less than a spacing.  Unloading takes as much from both sides of it, so v at the
    peak is found.
    """
    last = lowered[start + 2 * step]
    out = lowered[start + 3 * step]
    if out > 0:
        link[FLOWED] = 2.0 if last > 0 else 0.0
        return
    fall = 0.0
    if last > 0:
        link[FLOWED] = 1.0
        if (1 - NARROW) * (link[2] + last - link[3]) <= hardness:
            return  # not an edge
        fall = hardness - link[2]
        link[UNLOADED] = fall / hardness
    for j in range(6):
        link[j] += fall
        if j < 3 and lowered[start + j * step] > 0:
            link[j] += lowered[start + j * step]
            link[TOP] = min(link[TOP], hardness, link[j])


@compiled
def _add_segments(  # noqa: PLR0915 - many sums over the same segment
    grid: Any,
    cells: Any,
    count: int,
    links: Links,
    limits: tuple[float, float],
    offsets: FloatArray,
    out: Any,
) -> None:
    """Add the straight segments of a front, and its narrow tips, to sums.

    Each cell that the front crosses has one or two segments, between its links.

    grid: the `_Grid` of a block; cells: its `_Cells`; count: number of crossed cells;
    links: the located front on each link; limits: hardness in Pa now and under the
    earlier loads; offsets: offset of a front in spacings by the width of the elastic
    strip beside it, with _FINE entries for a width of one spacing; out: structured
    array (1,) with the fields of `Sums`, to which is added.
    """
    hardness, earlier_hardness = limits
    sums = out[0]
    for m in range(count):
        k = np.uint64(cells.crossed[m])
        code = int(cells.codes[k])
        if code & _BEFORE:
            continue
        code &= _CORNERS
        last_inside = int(grid.state[k] > 0)
        if last_inside:
            code ^= _CORNERS  # now 2^k for each corner inside
        cut = _CUT[code]
        straight = code % 3 == 0  # two corners beside each other are inside
        saddle = code % 5 == 0  # two corners opposite each other are inside
        slope_x, slope_y, centre = _gradient(grid, grid.v, k)
        if saddle and centre > 0:  # the inside is connected
            cut ^= 1
        flatness = 1 / max(slope_x * slope_x + slope_y * slope_y, 1e-300)
        product = slope_x * slope_y * flatness
        cos4 = 1 - 8 * product * product
        sin4 = 4 * product * (slope_x - slope_y) * (slope_x + slope_y) * flatness
        steepness = math.sqrt(flatness)
        own_fraction = min(hardness * steepness, 1.0) ** 2
        width = earlier_hardness * steepness
        peak_strip = 0.0
        if len(grid.lowered):
            width = _peak_width(grid, k, slope_x, slope_y, earlier_hardness, width)
            peak_strip = strip_width(min(width, 1.0))
        sides = (
            cells.link_x[k - grid.unit],
            cells.link_y[k],
            cells.link_x[k],
            cells.link_y[k - grid.columns],
        )
        cut_inside = (code >> cut) & 1
        sign = 2.0 * cut_inside - 1
        sums.area += 1 - cut_inside - last_inside  # which was counted as a point
        for corner in range(cut, cut + (3 if saddle else 1), 2):
            one = np.uint64(sides[(corner + straight) & 3])
            other = np.uint64(sides[(corner + 3) & 3])
            # Distances of the crossings from the corner, along both sides.
            x = 1 - cut_inside + sign * links.position[one]
            y = 1 - cut_inside + sign * links.position[other]
            released = 0.0
            if len(grid.lowered):
                back_x = released_width(links.unloaded_fraction[one], peak_strip)
                back_y = released_width(links.unloaded_fraction[other], peak_strip)
                x -= sign * back_x
                y -= sign * back_y
                released = (back_x + back_y) / 2
            if straight:
                length = math.sqrt(1 + (x - y) * (x - y))
                sums.area += sign * (x + y) / 2
            else:
                length = math.sqrt(x * x + y * y)
                sums.area += sign * x * y / 2
                sums.turn += 0.25 * sign
            held = (links.pinned[one] + links.pinned[other]) / 2
            own_length = max(own_fraction, held) * length
            sums.length += own_length
            sums.shared += length - own_length
            sums.pinned += held * own_length
            sums.at_kink += (links.at_kink[one] + links.at_kink[other]) / 2 * own_length
            hidden_width = (links.hidden_width[one] + links.hidden_width[other]) / 2
            sums.hidden_zone += hidden_width * length
            sums.released += released * length
            # The width of the strip follows from the slope of both its fronts.
            strip = width * (1 + (links.steepening[one] + links.steepening[other]) / 4)
            entry = np.uint64(min(_FINE * strip + 0.5, len(offsets) - 1.0))
            offset = offsets[entry] * (1 - held) * length
            sums.offset += offset
            sums.offset_cos += cos4 * offset
            sums.offset_sin += sin4 * offset
            position_error = (links.uncertainty[one] + links.uncertainty[other]) / 2
            sums.uncertainty += position_error * own_length * (1 - held)
            variance = position_error * position_error * (1 - held)
            if released > 0:
                variance += NARROW**2
            sums.scatter += variance * own_length
        sums.tips += _tip(grid, k, hardness)


@inlined
def _gradient(grid: Any, field: Any, k: Any) -> tuple[float, float, float]:
    """Return the slopes of a field along x and y in a cell, and the sum of its values.

    Slopes are per spacing, and means of two sides of the cell.  The sum is that of the
    four corners in both layers of the field (for links along x and along y).

    grid: the `_Grid` of a block; field: its v or lowered; k: number of the cell, that
    is, of its corner with the largest indices.
    """
    unit = grid.unit
    columns = grid.columns
    # Corners 0 to 3 of the cell in the layer for links along x, then along y.
    a = field[k - columns - unit]
    b = field[k - unit]
    c = field[k]
    d = field[k - columns]
    q = k + grid.layer
    e = field[q - columns - unit]
    f = field[q - unit]
    g = field[q]
    h = field[q - columns]
    return (b + c - a - d) / 2, (g + h - e - f) / 2, a + b + c + d + e + f + g + h


@inlined
def _peak_width(
    grid: Any, k: Any, slope_x: float, slope_y: float, hardness: float, width: float
) -> float:
    """Return the width, at the peak load, of the elastic strip in a cell, in spacings.

    The strip lies between the front of the contact and its plastic part.  The width is
    infinite if all corners flowed under the peak load.

    grid: the `_Grid` of a block; k: number of the cell; slope_x, slope_y: slopes of v
    in Pa per spacing at the present load; hardness: in Pa, at the peak load; width: the
    result if no corner flowed under the peak load.
    """
    lowered = grid.lowered
    unit = grid.unit
    columns = grid.columns
    flow_slope_x, flow_slope_y, total = _gradient(grid, lowered, k)
    if total == 0:
        return width
    least = min(lowered[k], lowered[k - unit])
    least = min(least, lowered[k - columns], lowered[k - columns - unit])
    if least > 0:
        return math.inf
    slope = math.hypot(slope_x + flow_slope_x, slope_y + flow_slope_y)
    return hardness / max(slope, 1e-150)


@inlined
def _tip(grid: Any, k: Any, hardness: float) -> float:
    """Return the weight, from 0 to 1, of a point as a tip of a gap.

    A tip is the end of a gap that is narrower than a spacing.  A point is a tip if it
    is out of contact, at most two of its eight neighbours are, and contact touches it
    both along x and along y.  Its weight is the square of the width of the elastic
    strip beside it, in spacings and at most 1; the width is the hardness over the
    largest difference of v to a neighbour.

    grid: the `_Grid` of a block; k: number of the point; hardness: in Pa.
    """
    unit = grid.unit
    columns = grid.columns
    layer = grid.layer
    v = grid.v
    state = grid.state
    apart = 0
    for row in (k - columns, k, k + columns):
        apart += (state[row - unit] == 0) + (state[row] == 0) + (state[row + unit] == 0)
    along = state[k - unit] | state[k + unit]
    across = state[k - columns] | state[k + columns]
    if (state[k] > 0) | (along == 0) | (across == 0) | (apart > 3):
        return 0.0
    steepest = 0.0
    for row in (k - columns, k, k + columns):
        for near in (row - unit, row, row + unit):
            rise = v[near] + v[near + layer] - v[k] - v[k + layer]
            steepest = max(steepest, abs(rise) / 2)
    return min(hardness / steepest, 1.0) ** 2


@compiled
def _add_hidden(grid: Any, elastic: Any, count: int, hardness: float, out: Any) -> None:
    """Add to sums the gaps between elastic points that no grid point shows.

    grid: the `_Grid` of a block; elastic: numbers of the elastic points, overwritten;
    count: how many there are; hardness: in Pa; out: structured array (1,) with the
    fields of `Sums`, to which is added.

    In full contact p is a smooth wave.  If it would fall to -p1 + p2 s^2 at the
    distance s from its lowest place, a gap of radius sqrt(3 p1/(2 p2)) opens, as a
    penny-shaped crack that closes smoothly.  This place is at most half a cell's
    diagonal away, so that p1 <= p2/2 - p.  At a crease (`hidden`) the pressure along it
    changes less than across it, by ALIKE; if it is 0 there, the gap shows.  A lone
    point may be on a wedge.
    """
    unit = grid.unit
    columns = grid.columns
    layer = grid.layer
    v = grid.v
    sums = out[0]
    low = 0
    for k in elastic[:count]:  # without branches, hard to foresee
        elastic[np.uint64(low)] = k
        low_x = v[k] <= min(v[k - columns], v[k + columns])
        low_y = v[k] <= min(v[k - unit], v[k + unit])
        low += low_x | low_y
    for k in elastic[:low]:
        here = v[k]
        lowest = True
        around = 0.0
        area = 0.0
        for axis in range(2):
            q = k
            across = columns
            along = unit
            if axis == 1:
                q = k + layer
                across = unit
                along = columns
            before = v[q - across]
            after = v[q + across]
            if here > min(before, after):
                lowest = False
                continue
            first = v[q - across - across]
            end = v[q + across + across]
            if min(before, after) >= hardness:
                ridge = wedge_width(hardness, first, before, here, after, end)
                area = max(area, ridge)
            same_kind = (before < hardness) == (after < hardness)
            before = min(before, hardness)
            after = min(after, hardness)
            around += before + after
            least_one = _least(v, q - along, across, hardness)
            least_other = _least(v, q + along, across, hardness)
            change_along = max(max(least_one, least_other) - here, 0.0)
            most = ALIKE * (max(before, after) - here)
            if same_kind and min(least_one, least_other) > 0 and change_along < most:
                first = min(max(first, 0.0), hardness)
                end = min(max(end, 0.0), hardness)
                half_width, _ = crease_gap(first, before, here, after, end)
                area = max(area, 2 * half_width * (1 - change_along / most))
        sums.crease_area += area
        # p2 of a wave whose points are a quarter of it apart.
        p2 = math.pi**2 / 8 * (around / 4 - here)
        if lowest and p2 > 0:  # ±0 if flat
            sums.gap_squares += max(math.pi * 1.5 * (0.5 - here / p2), 0.0) ** 2


@inlined
def _least(v: Any, q: Any, across: Any, hardness: float) -> Any:
    """Return the least v (Pa) of a point and its two neighbours, at most the hardness.

    v: values of all points; q: index of the point; across: difference of the indices
    of neighbours; hardness: in Pa.
    """
    return min(v[q - across], v[q], v[q + across], hardness)
