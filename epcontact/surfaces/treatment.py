"""The treatment that makes a measured map a surface: holes, form, edges, band.

A map is treated in this order, and each step adds a sentence to the notes of the
surface:

1. outliers, spikes of an instrument, are found, and lose their heights if the user asks
   for it;
2. a least-squares polynomial (`form`), fitted to the points that have a height, is
   removed;
3. points without a height (NaN) are filled;
4. the map is mirrored at its edges, or taken as it is;
5. waves outside a band are removed.

A plateau at the highest or the lowest height of a map is the end of the instrument's
range: the heights there are kept, but count as not measured.  The module `alternatives`
makes the other heights that the removed plane and the filled points may have.

Every method here is periodic, but a measured map rarely is: its heights jump across its
edges.  A map counts as not periodic if the rms difference of its last and first rows is
more than `LARGEST_JUMP` times the largest rms difference of two neighbouring rows.
Jumps at the edges are cliffs, which count as slope in the spectrum of the map and carry
load as edges of punches do.  A mirrored map has no such cliffs; it has four times the
points.  `laboratory.treatment` shows what each treatment does to the results.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import StrictFloat

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import (
    Alternative,
    Surface,
    levels_note,
    number,
    require_usable,
    set_frozen,
    warn_user,
)
from epcontact.surfaces.alternatives import form_alternatives, hole_alternatives
from epcontact.surfaces.power_spectrum import band_pass, inner_moments, surface_moments
from epcontact.surfaces.recipe import Fields, entry

Treatment = Literal["mirrored", "periodic", "refuse"]
EdgeField = Annotated[
    Treatment,
    entry("", "of the edges: mirrored, taken as they are, or refused if heights jump"),
]

#: Edge jump over the largest jump between neighbours, above which a map counts as not
#: periodic.
LARGEST_JUMP = 2.0
#: An outlier is further from the median of its neighbours than SPIKE times the distance
#: within which 99 of 100 neighbours are, and than SPREAD times the spread of the
#: heights around it.  Clean maps of 20 kinds reach 4.1 and 0.87, spikes of four times
#: the rms height 4.4 and 1.1 to 40 (`laboratory.trial_map`).
SPIKE, SPREAD = 3.0, 1.2
#: A map is clipped if at least FEWEST_CLIPPED points have its highest (or lowest)
#: height, and CLIPPED times as many as any of the NEXT_LEVELS heights below (above):
#: the tails of a height distribution become thinner toward its ends.
FEWEST_CLIPPED, CLIPPED, NEXT_LEVELS = 8, 4, 8
#: Heights are rounding errors, and the map is flat, if their rms is below this fraction
#: of the largest height before form was removed.
ROUNDING = 1e-12
#: Factors of the errors by the treatment of edges.  An error is the factor times rms
#: slope over rms curvature over the shorter side of the map.  Errors of areas are
#: fractions of the total area, and the others are relative.  Nine of ten maps of six
#: kinds of surfaces stay within them (`laboratory.treatment --full`).
EDGE_ERRORS = {
    "mirrored": {
        "total_area": 1.5,
        "elastic_area": 2.6,
        "plastic_area": 1.2,
        "stiffness_loading": 5.0,
        "stiffness_unloading": 2.7,
        "conductance": 2.7,
    },
    "periodic": {"total_area": 2.5, "elastic_area": 4.3, "plastic_area": 1.7},
}
#: Relative errors by the treatment of edges that do not fall with the size of the map.
EDGE_FRACTIONS = {
    "mirrored": {"mean_gap": 0.04, "contact_percolation": 0.4, "gap_percolation": 0.32},
    "periodic": {
        "mean_gap": 0.078,
        "contact_percolation": 1.4,
        "gap_percolation": 0.2,
        "stiffness_loading": 0.15,
        "stiffness_unloading": 0.24,
        "conductance": 0.24,
    },
}
#: What the polynomials of total order 0, 1 and 2 are called in notes.
_FORMS = ("mean height", "least-squares plane", "least-squares quadratic form")
#: Most outliers whose positions a note lists.
_LISTED = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Preparation(Fields):
    """The steps that a recipe of measured heights can ask for, beside `treatment`.

    A note reports outliers that are kept; removed outliers are filled like missing
    heights.  The method "nearest" gives a missing height that of the nearest point.
    The method "harmonic" spans a hole like a soap film (the solution of Laplace's
    equation).  A plateau at the highest or lowest height of a map counts as clipped by
    the instrument, unless `clipped` is "keep".  By default, `form` is 1 for a map that
    is mirrored, and for a map that is taken as periodic though its heights jump at the
    edges mostly because of a tilt.
    """

    missing: Annotated[
        Literal["refuse", "nearest", "harmonic"],
        entry("", "points without a height: refused, or filled by this method"),
    ] = "refuse"
    outliers: Annotated[
        Literal["keep", "remove"],
        entry(
            "",
            "spikes of an instrument: kept with a note, or removed and filled "
            "(harmonic)",
        ),
    ] = "keep"
    clipped: Annotated[
        Literal["missing", "keep"],
        entry(
            "",
            "plateaus at the end of the range of heights: not measured, or kept as "
            "measured",
        ),
    ] = "missing"
    form: Annotated[
        Literal[0, 1, 2] | None,
        entry(
            "", "order of the polynomial that is removed: 0 mean, 1 tilt, 2 curvature"
        ),
    ] = None
    longest_wavelength: Annotated[
        StrictFloat | None, entry("m", "longer waves are removed", gt=0)
    ] = None
    shortest_wavelength: Annotated[
        StrictFloat | None, entry("m", "shorter waves are removed", gt=0)
    ] = None

    def __post_init__(self: Any) -> None:
        """Check the steps of this recipe.

        Raises InvalidScene if a value is not allowed, or if the shortest wavelength is
        not below the longest.
        """
        super().__post_init__()
        if self.form is not None:
            form = number("form", self.form, "0, 1 or 2", lambda v: v in (0, 1, 2))
            set_frozen(self, form=int(form))
        longest = self.longest_wavelength
        shortest = self.shortest_wavelength
        if longest is not None and shortest is not None and not shortest < longest:
            raise InvalidScene(
                f"shortest_wavelength is {shortest:g} m, but must be below "
                f"longest_wavelength = {longest:g} m"
            )

    @property
    def steps(self: Any) -> str:
        """The treatment of this recipe as a text, a part of the recipe's fingerprint.

        Steps that are left at their defaults are not named.
        """
        words: str = f"{self.treatment}/3"
        defaults = {step.name: step.default for step in fields(Preparation)}
        for name in (
            "missing",
            "outliers",
            "clipped",
            "form",
            "longest_wavelength",
            "shortest_wavelength",
        ):
            value = getattr(self, name)
            if value != defaults[name]:
                words += f" {name}={value!r}"
        return words


def prepare_surface(
    given: NDArray[Any],
    recipe: Any,
    where: str,
    notes: Iterable[str] = (),
    unit: float = 1.0,
    filled_before: NDArray[np.bool_] | None = None,
    otherwise: FloatArray | None = None,
) -> Surface:
    """Treat the heights of a map as its recipe says, and return the surface.

    The mask `Surface.filled` marks the heights that are filled here and those that were
    filled before.

    Args:
        given: heights (nx, ny) or (nx,) in `unit`, NaN where missing.
        recipe: a `Preparation` with `treatment`, `periods` (m) and `fingerprint`.
        where: the name of the argument or file, with which a message begins.
        notes: sentences on how the heights were read.
        unit: the unit of the heights, in m.
        filled_before: mask of the heights that an earlier treatment filled, if any.
        otherwise: the heights that another interpolation gives, like `given`, if these
            were interpolated.

    Raises:
        InvalidScene: Heights are missing and must not be filled, have an impossible
            size, or jump at the edges and are refused for it.
    """
    heights = np.multiply(given, unit, dtype=np.float64, order="C")
    require_usable(heights, where, recipe.missing)
    said = [*warn_user(levels_note(given.dtype)), *notes, *_mark_notes(heights, unit)]
    spikes = find_outliers(heights)
    if spikes.any():
        said += _spike_notes(heights, spikes, recipe)
        if recipe.outliers == "remove":
            heights[spikes] = np.nan
    clipped_below = clipped_above = np.zeros(heights.shape, bool)
    if recipe.clipped == "missing":
        clipped_below = find_clipped(heights, -1)
        clipped_above = find_clipped(heights, 1)
        said += _clipped_notes(clipped_below, clipped_above)
    unset = recipe.treatment == "periodic" and recipe.form is None
    tilted = unset and _is_tilted(heights)
    heights, order, form_notes = _without_form(heights, recipe, tilted)
    said += form_notes
    filled = np.isnan(heights)
    if filled.any():
        heights, fill_notes = _without_holes(heights, given, recipe.missing)
        said += fill_notes
    filled |= clipped_below | clipped_above
    if filled_before is not None:
        filled |= filled_before
    mirrored = recipe.treatment == "mirrored"
    forms = form_alternatives(heights, order, mirrored)
    if recipe.longest_wavelength is not None:
        forms = []  # a plane belongs to the longest waves, which are removed
    said += _form_notes(forms)
    least = np.where(clipped_above, heights, -np.inf)[filled]
    most = np.where(clipped_below, heights, np.inf)[filled]
    alternatives = [
        *forms,
        *hole_alternatives(heights, filled, least, most),
        *_interpolated_alternatives(given, otherwise, unit),
    ]
    jumps = edge_jumps(heights)
    said.append(f"rms jump at the edges: {_jump_words(jumps)}")
    if recipe.treatment == "refuse" and _is_jumping(jumps):
        raise InvalidScene(
            f'{where}: not periodic, {said[-1]}; set treatment to "mirrored", which '
            'mirrors the map at its edges, or to "periodic" to take it as it is'
        )
    periods = recipe.periods
    if mirrored:
        added = [(0, n) for n in heights.shape]
        heights = np.pad(heights, added, mode="symmetric")
        filled = np.pad(filled, added, mode="symmetric")
        periods = tuple(2 * p for p in periods)
        said.append(
            "mirrored at its edges, so that the period is twice the map each way"
        )
    heights, band_notes = _within_band(heights, periods, recipe)
    said += band_notes
    heights.flags.writeable = False
    surface = Surface(
        heights,
        periods,
        shortest_wavelength=recipe.shortest_wavelength,
        recipe=recipe.fingerprint,
        notes=tuple(said),
        filled=filled,
        sampled=True,
    )
    treated = mirrored or tilted or _is_jumping(jumps)
    surface = _with_edge_errors(surface, recipe, treated)
    return _with_alternatives(surface, alternatives, recipe)


# --- outliers and marks ---------------------------------------------------------------


def _mark_notes(heights: FloatArray, unit: float) -> Iterator[str]:
    """Yield a warning of a repeated height that is far from all others, such as -9999.

    An instrument may use such a number to mark points without a height.

    Args:
        heights: (nx, ny) or (nx,), in m, NaN where missing.
        unit: the unit of the heights in the file, in m; the note has that unit.
    """
    for mark in (np.nanmin(heights), np.nanmax(heights)):
        marked = heights == mark
        rest = heights[~marked & ~np.isnan(heights)]
        count = int(np.count_nonzero(marked))
        if count >= 2 and rest.size and 0 < np.ptp(rest) < np.abs(rest - mark).min():
            yield (
                f"{count} heights are {mark / unit:.6g}, far from all others; if this "
                "marks points without a height, write NaN in its place"
            )


def find_outliers(heights: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the outliers of a map: spikes of at most two points' width.

    A spike is far from the median of its 3 x 3 neighbourhood, compared with usual
    differences of neighbours (`SPIKE`) and with the spread of the heights in the ring
    of points around it (`SPREAD`).

    Args:
        heights: (nx, ny) or (nx,), in any unit; NaN where missing, which is no outlier.

    Returns:
        An array of the shape of the heights, True at outliers.
    """
    from scipy import ndimage

    missing = np.isnan(heights)
    complete = fill_holes(heights, "nearest")
    axes = range(complete.ndim)
    steps = [np.abs(np.diff(complete, axis=axis)).ravel() for axis in axes]
    usual = float(np.percentile(np.concatenate(steps), 99))
    medians = ndimage.median_filter(complete, 3, mode="mirror")
    distance = np.abs(complete - medians)
    spikes = distance > SPIKE * usual
    if usual == 0 or not spikes.any() or min(complete.shape) < 4:
        return np.zeros(complete.shape, bool)
    ring = np.ones((7,) * complete.ndim, bool)
    ring[(slice(2, 5),) * complete.ndim] = False
    padded = np.pad(complete, 3, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, ring.shape)
    around = windows[spikes][:, ring]
    low, high = np.percentile(around, (10, 90), axis=1)
    spikes[spikes] = distance[spikes] > SPREAD * (high - low)
    return np.asarray(spikes & ~missing)


def _spike_notes(
    heights: FloatArray, spikes: NDArray[np.bool_], recipe: Any
) -> Iterator[str]:
    """Yield a note on the number of outliers and their positions.

    If the outliers stay in the map, the note is also a warning to the user.

    Args:
        heights: (nx, ny) or (nx,).
        spikes: the mask of the outliers, of the same shape, with at least one.
        recipe: a `Preparation` with `periods` (m).
    """
    spacing = np.divide(recipe.periods, heights.shape)
    points = np.argwhere(spikes)
    places = []
    for place in (points[:_LISTED] * spacing).tolist():
        coordinates = ", ".join(f"{x:.3g}" for x in place)
        places.append(f"({coordinates})")
    where = ", ".join(places)
    if len(points) > _LISTED:
        where += f" and {len(points) - _LISTED} more"
    count = f"{len(points)} of {heights.size} heights are outliers, "
    count += "spikes far above or below all around"
    if recipe.outliers == "remove":
        yield f"{count}: removed, at {where} m"
    else:
        note = (
            f"{count}: at {where} m; the contact sees them as roughness: if they are "
            'the instrument\'s, set outliers to "remove"'
        )
        yield from warn_user((note,))


def find_clipped(heights: FloatArray, end: Literal[-1, 1]) -> NDArray[np.bool_]:
    """Return the mask of the points that the range of an instrument has clipped.

    They have the highest or the lowest height of the map, and are many more than those
    of the heights beside it (see CLIPPED).  A height that is far from all others is
    rather a mark of missing heights, and no clipping.

    Args:
        heights: (nx, ny) or (nx,), in any unit, NaN where missing.
        end: 1 for the highest heights, -1 for the lowest.

    Returns:
        An array of the shape of the heights, True at clipped points.
    """
    measured = heights[~np.isnan(heights)]
    levels, counts = np.unique(-end * measured, return_counts=True)
    nearest = counts[1 : 1 + NEXT_LEVELS]
    is_clipped = (
        levels.size > 2 * NEXT_LEVELS
        and counts[0] >= max(FEWEST_CLIPPED, CLIPPED * nearest.max())
        and levels[1] - levels[0] <= levels[-1] - levels[1]
    )
    if not is_clipped:
        return np.zeros(heights.shape, bool)
    return np.asarray(heights == -end * levels[0])


def _clipped_notes(below: NDArray[np.bool_], above: NDArray[np.bool_]) -> Iterator[str]:
    """Yield a warning for each end of the range at which heights are clipped.

    Args:
        below: mask of the points at the lowest height, if the map is clipped there.
        above: mask of the points at the highest height.
    """
    for mask, words in ((above, "highest"), (below, "lowest")):
        count = np.count_nonzero(mask)
        if count:
            yield from warn_user(
                (
                    f"{count} of {mask.size} heights are the {words} one "
                    f"({100 * count / mask.size:.2g} %): the range of the instrument "
                    "has probably clipped them; they count as not measured. Measure "
                    'with a larger range, or set clipped to "keep" if this plateau is '
                    "real",
                )
            )


# --- form and holes -------------------------------------------------------------------


def _without_form(
    heights: FloatArray, recipe: Any, tilted: bool
) -> tuple[FloatArray, int, list[str]]:
    """Return the heights of a map without its form, a least-squares polynomial.

    If the recipe does not state a form, a plane is removed from a map that is mirrored
    or tilted, and nothing from any other map.

    Args:
        heights: (nx, ny) or (nx,), in m, NaN where missing.
        recipe: a `Preparation` with `treatment`.
        tilted: True if the map jumps at its edges because it is tilted.

    Returns:
        The heights (the same array if nothing is removed), the order of the removed
        polynomial (0 if there is none), and sentences on what was removed.
    """
    order = recipe.form
    if order is None and (tilted or recipe.treatment == "mirrored"):
        order = 1
    largest = float(np.nanmax(np.abs(heights)))
    notes = []
    if order is not None:
        heights = remove_form(heights, order)
        notes.append(f"{_FORMS[order]} removed")
        if tilted:
            notes[0] += ", because its tilt makes the edges jump; form = 0 keeps it"
    if 0 < np.nanstd(heights) < ROUNDING * largest:
        heights = np.where(np.isnan(heights), np.nan, 0.0)
        notes.append("the rest is rounding error, and the surface is flat")
    return heights, order or 0, notes


def _interpolated_alternatives(
    given: NDArray[Any], otherwise: FloatArray | None, unit: float
) -> Iterator[Alternative]:
    """Yield the alternative of heights that were interpolated, if there are such.

    Args:
        given: the interpolated heights in `unit`, NaN where missing.
        otherwise: those of another interpolation, or None.
        unit: the unit of the heights, in m.
    """
    if otherwise is not None:
        change = np.nan_to_num(unit * (otherwise - given))
        points = np.nonzero(change)
        yield Alternative("missing", points, (change[points],))


def _form_notes(alternatives: list[Alternative]) -> Iterator[str]:
    """Yield a note on how far the removed form may be off, if there are alternatives.

    Args:
        alternatives: those of the form, whose first one has a profile (m) along each
            axis.
    """
    if alternatives:
        tilts = [float(np.ptp(profile)) for profile in alternatives[0].changes]
        words = " and ".join(f"{tilt:.3g} m" for tilt in tilts)
        yield (
            f"the removed form may be off by {words} along the sides of the map, as "
            "opposite edges would meet then; a part of the error of each value (form)"
        )


def _is_tilted(heights: FloatArray) -> bool:
    """Return True if heights jump at an edge mostly because the map is tilted.

    Without its least-squares plane, the jump at that edge is then less than half.

    Args:
        heights: (nx, ny) or (nx,), NaN where missing.
    """
    complete = fill_holes(heights, "nearest")
    jumps = edge_jumps(complete)
    level_jumps = edge_jumps(remove_form(complete, 1))
    for jump, (level_edge, _) in zip(jumps, level_jumps, strict=True):
        if _is_jumping([jump]) and level_edge < jump[0] / 2:
            return True
    return False


def remove_form(heights: FloatArray, order: int) -> FloatArray:
    """Return a new array of heights without their least-squares polynomial of x and y.

    Args:
        heights: (nx, ny) or (nx,); points that are NaN stay so and do not count.
        order: the total order of the polynomial, 0, 1 or 2.
    """
    rest = heights.reshape(len(heights), -1).copy()
    measured = ~np.isnan(rest)
    nx, ny = rest.shape
    x = np.polynomial.legendre.legvander(np.linspace(-1, 1, nx), order)
    y = np.polynomial.legendre.legvander(np.linspace(-1, 1, ny), order)
    orders = np.arange(order + 1)
    used = orders[:, None] + orders <= order
    weights = measured * 1.0
    normal = np.einsum("xi,xk,xy,yj,yl->ijkl", x, x, weights, y, y, optimize=True)
    matrix = normal[used][:, used]
    coefficients = np.zeros(used.shape)
    for _ in range(2):  # the second pass removes what rounding left of a large form
        moments = x.T @ np.where(measured, rest, 0.0) @ y
        coefficients[used] = np.linalg.lstsq(matrix, moments[used])[0]
        rest -= x @ coefficients @ y.T
    return rest.reshape(heights.shape)


def _without_holes(
    heights: FloatArray, given: NDArray[Any], missing: str
) -> tuple[FloatArray, list[str]]:
    """Return the heights of a map with all missing ones filled, and notes on them.

    Args:
        heights: (nx, ny) or (nx,), in m, NaN where missing or removed as an outlier.
        given: the heights before outliers were removed, of the same shape.
        missing: the method, "nearest" or "harmonic"; "refuse": only removed outliers
            are missing, which are filled by the method "harmonic".

    Returns:
        The heights, and a list of one sentence if the given map has missing heights.
    """
    method = "harmonic" if missing == "refuse" else missing
    absent = int(np.count_nonzero(np.isnan(given)))
    notes = []
    if absent:
        percent = f"{100 * absent / heights.size:.2g} %"
        count = f"{absent} of {heights.size} heights missing ({percent})"
        notes.append(f"{count}, filled by the method {method}")
    return fill_holes(heights, method), notes


def fill_holes(heights: FloatArray, method: str) -> FloatArray:
    """Return heights in which every NaN is replaced by a value from its neighbours.

    Without a NaN, the given array itself is returned.

    Args:
        heights: (nx, ny) or (nx,), in any unit, with at least one height.
        method: "nearest" takes the height of the nearest point.  "harmonic" solves
            Laplace's equation: each filled height is the mean of its neighbours.
    """
    from scipy import ndimage, sparse

    holes = np.isnan(heights)
    if not holes.any():
        return heights
    if method == "nearest":
        _, nearest = ndimage.distance_transform_edt(holes, return_indices=True)
        return np.asarray(heights[tuple(nearest)])
    points = np.argwhere(holes)
    size = len(points)
    numbers = np.full(heights.shape, -1)
    numbers[holes] = np.arange(size)
    neighbours = np.zeros(size)
    sums = np.zeros(size)  # of the heights of the neighbours that have one
    links: Any = sparse.csc_matrix((size, size))
    for axis, step in itertools.product(range(heights.ndim), (-1, 1)):
        beside = points.copy()
        beside[:, axis] += step
        inside = (beside[:, axis] >= 0) & (beside[:, axis] < heights.shape[axis])
        rows = np.flatnonzero(inside)
        positions = tuple(beside[inside].T)
        neighbours[rows] += 1
        sums[rows] += np.nan_to_num(heights[positions])
        columns = numbers[positions]
        linked = columns >= 0
        pairs = (rows[linked], columns[linked])
        links += sparse.csc_matrix((np.ones(pairs[0].size), pairs), links.shape)
    matrix = (sparse.diags(neighbours) - links).tocsc()
    result = heights.copy()
    result[holes] = sparse.linalg.spsolve(matrix, sums)
    return result


# --- edges and band -------------------------------------------------------------------


def edge_jumps(heights: FloatArray) -> list[tuple[float, float]]:
    """Return for each axis the jump at the edge and the largest jump inside.

    A jump is the rms difference of two rows across the axis: the last and the first row
    at the edge, neighbouring rows inside.

    Args:
        heights: (nx, ny) or (nx,), in any unit, without NaN.

    Returns:
        A pair (jump at the edge, largest jump inside) for each axis, in the unit of the
        heights.
    """
    jumps = []
    for axis in range(heights.ndim):
        edge = np.take(heights, 0, axis) - np.take(heights, -1, axis)
        steps = np.diff(heights, axis=axis)
        steps *= steps
        inside = steps if heights.ndim == 1 else steps.mean(axis=1 - axis)
        jumps.append((math.sqrt(np.mean(edge * edge)), math.sqrt(inside.max())))
    return jumps


def _is_jumping(jumps: list[tuple[float, float]]) -> bool:
    """Return True if the jump at an edge is too large for a periodic map.

    Args:
        jumps: for each axis the rms jump at the edge and the largest rms jump between
            neighbouring rows, in one unit, as `edge_jumps` returns them.
    """
    return any(edge > LARGEST_JUMP * inside for edge, inside in jumps)


def _jump_words(jumps: list[tuple[float, float]]) -> str:
    """Return the jumps of a map in words, for a note.

    Args:
        jumps: for each axis the rms jump at the edge and the largest rms jump between
            neighbouring rows, in m.
    """
    words = []
    for axis, (edge, inside) in zip("xy", jumps, strict=False):
        neighbours = f"between neighbours at most {inside:.3g} m"
        words.append(f"{edge:.3g} m across {axis} ({neighbours})")
    return " and ".join(words)


def _within_band(
    heights: FloatArray, periods: tuple[float, ...], recipe: Any
) -> tuple[FloatArray, list[str]]:
    """Return the heights without the waves that the recipe removes.

    Args:
        heights: (nx, ny) or (nx,), in m, without NaN.
        periods: lengths of the period along each direction, in m.
        recipe: its `longest_wavelength` and `shortest_wavelength` (m, or None) are the
            limits of the band.

    Returns:
        The heights (the same array if no limit is given), and a list of one sentence if
        waves are removed.
    """
    bounds = []
    lowest, highest = 0.0, math.inf
    if recipe.longest_wavelength is not None:
        bounds.append(f"longer than {recipe.longest_wavelength:.3g} m")
        lowest = 2 * math.pi / recipe.longest_wavelength
    if recipe.shortest_wavelength is not None:
        bounds.append(f"shorter than {recipe.shortest_wavelength:.3g} m")
        highest = 2 * math.pi / recipe.shortest_wavelength
    if not bounds:
        return heights, []
    note = f"waves {' and '.join(bounds)} removed"
    return band_pass(heights, periods, highest, lowest), [note]


def _with_edge_errors(surface: Surface, recipe: Any, treated: bool) -> Surface:
    """Return the surface with notes on its slopes and the errors by its edges.

    The errors are those that the treatment of the edges causes in results, as fractions
    (see EDGE_ERRORS).  A flat map has none.

    Args:
        surface: the treated surface.
        recipe: a `Preparation` with `treatment` and the map's `periods` (m).
        treated: True if the map is mirrored, was tilted, or jumps at its edges; a
            periodic map has no such errors.
    """
    inside = inner_moments(surface)
    notes = [*surface.notes, *_slope_notes(surface, inside.rms_slope)]
    if not treated or inside.rms_curvature == 0:
        return surface.annotated(notes=tuple(notes))
    length = inside.rms_slope / inside.rms_curvature / min(recipe.periods)
    errors = {
        name: length * factor for name, factor in EDGE_ERRORS[recipe.treatment].items()
    }
    errors |= EDGE_FRACTIONS[recipe.treatment]
    values = ", ".join(
        f"{name.replace('_', ' ')} {100 * error:.3g} %"
        for name, error in errors.items()
    )
    notes.append(
        f"in nine of ten maps, the treatment of the edges ({recipe.treatment}) changes "
        f"values by up to {values} (areas relative to the total area); this is a part "
        "of the error of each value"
    )
    return surface.annotated(notes=tuple(notes), treatment_errors=errors)


def _with_alternatives(
    surface: Surface, alternatives: Iterable[Alternative], recipe: Any
) -> Surface:
    """Return the surface with the alternatives of its map.

    Args:
        surface: the treated surface.
        alternatives: those of the map, before it was mirrored and filtered.
        recipe: a `Preparation` with `treatment` and `shape`.
    """
    is_filtered = recipe.longest_wavelength or recipe.shortest_wavelength
    on_surface = []
    for alternative in alternatives:
        if alternative.points is ... and not is_filtered:
            on_surface.append(_mirrored_profiles(alternative, surface.shape))
            continue
        change = np.zeros(recipe.shape)
        for term in alternative.changes:
            change[alternative.points] += term
        added = [
            (0, twice - size)
            for twice, size in zip(surface.shape, change.shape, strict=True)
        ]
        change = np.pad(change, added, mode="symmetric")
        change, _ = _within_band(change, surface.periods, recipe)
        points: Any = ...
        if not is_filtered:
            points = np.nonzero(change)
            change = change[points]
        on_surface.append(Alternative(alternative.source, points, (change,)))
    return surface.annotated(alternatives=tuple(on_surface))


def _mirrored_profiles(alternative: Alternative, shape: tuple[int, ...]) -> Alternative:
    """Return an alternative form with the mirror images of its profiles.

    Args:
        alternative: its changes are profiles along one axis each, on the map.
        shape: the grid of the surface, with as many points as the map along each axis
            or twice as many.
    """
    changes = []
    for axis, profile in enumerate(alternative.changes):
        added = [(0, 0)] * profile.ndim
        added[axis] = (0, shape[axis] - profile.shape[axis])
        changes.append(np.pad(profile, added, mode="symmetric"))
    return replace(alternative, changes=tuple(changes))


def _slope_notes(surface: Surface, slope: float) -> Iterator[str]:
    """Yield a note for each definition of the rms slope that gives another value.

    Args:
        surface: the treated surface.
        slope: its dimensionless rms slope by the spectrum without jumps at the edges.
    """
    by_steps = surface.rms_slope
    with_edges = surface_moments(surface).rms_slope
    if not math.isclose(slope, by_steps, rel_tol=0.01):
        yield (
            f"rms slope {slope:.4g} of the spectrum, which an effective hardness "
            f"takes, and {by_steps:.4g} from differences of neighbours"
        )
    if with_edges != slope:
        yield (
            "the jumps at the edges make the rms slope of the spectrum "
            f'{with_edges:.4g}, which a theory of spectrum = "surface" takes; '
            'treatment = "mirrored" has no jumps'
        )
