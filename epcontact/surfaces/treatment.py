"""The treatment that makes a measured map a surface: holes, form, edges, band.

A map is treated in this order, and a sentence on each step is among the notes of its
surface:

1. outliers, spikes of an instrument, are found, and lose their heights if the user asks
   for it;
2. a least-squares polynomial (`form`) is removed, fitted to the points that have a
   height;
3. points without a height (NaN) are filled;
4. the map is mirrored at its edges, or taken as it is;
5. waves outside a band are removed.

Every method here is periodic, but a measured map rarely is: its heights jump across its
edges.  A map counts as not periodic if the rms difference of its last and first rows is
more than `LARGEST_JUMP` times the largest one of two neighbouring rows.  Mirrored, a
map has no such cliffs, which count as slope in its spectrum and carry load as edges of
punches do; it has four times the points.  `epcontact chart treatment` shows what each
treatment does to the answers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import (
    Surface,
    levels_note,
    number,
    require_usable,
    set_frozen,
    warn_user,
)
from epcontact.surfaces.power_spectrum import inner_moments, kept_waves, surface_moments
from epcontact.surfaces.recipe import Fields, Real, entry

Treatment = Literal["mirrored", "periodic", "refuse"]
EdgeField = Annotated[
    Treatment,
    entry("", "of the edges: mirrored, taken as they are, or refused if heights jump"),
]

#: Edge jump over the largest jump between neighbours, above which a map counts as not
#: periodic.
LARGEST_JUMP = 2.0
#: An outlier is so many times as far from the median of its neighbours as 99 of 100
#: neighbours are apart, and times the spread of the heights around it.  Clean maps of
#: 20 kinds reach 4.1 and .87, spikes of four times the rms height 4.4 and 1.1 to 40
#: (`laboratory.trial_map`).
SPIKE, SPREAD = 3.0, 1.2
#: Heights whose rms is this share of those before form was removed are rounding: the
#: map is flat.
ROUNDING = 1e-12
#: Errors by the treatment of edges, to which nine of ten maps of six kinds of surfaces
#: keep (`epcontact chart treatment --full`), of areas over the total one.  These are
#: times rms slope over rms curvature over the shorter side; EDGE_SHARES do not fall
#: with the size of the map.
EDGE_ERRORS = {
    "mirrored": {"total_area": 1.5, "elastic_area": 2.6, "plastic_area": 1.2}
    | {"stiffness_loading": 5.0, "stiffness_unloading": 2.7, "conductance": 2.7},
    "periodic": {"total_area": 2.5, "elastic_area": 4.3, "plastic_area": 1.7},
}
EDGE_SHARES = {
    "mirrored": {"mean_gap": 0.03, "contact_percolation": 0.3, "gap_percolation": 0.32},
    "periodic": {"mean_gap": 0.078, "contact_percolation": 1.4, "gap_percolation": 0.2}
    | {"stiffness_loading": 0.15, "stiffness_unloading": 0.24, "conductance": 0.24},
}
_FORMS = {0: "mean height", 1: "least-squares plane", 2: "least-squares quadratic form"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Preparation(Fields):
    """The steps that a recipe of measured heights can ask for, beside `treatment`.

    Outliers are told if they are kept; removed ones are filled like missing heights,
    which are those of the nearest points ("nearest"), or span a hole like a soap film
    ("harmonic", the solution of Laplace's equation).  By default, `form` is 1 for a map
    that is mirrored, or taken as periodic though mostly a tilt makes its heights jump
    at the edges.
    """

    missing: Annotated[
        Literal["refuse", "nearest", "harmonic"],
        entry("", "points without a height: refused, or filled by this method"),
    ] = "refuse"
    outliers: Annotated[
        Literal["keep", "remove"],
        entry(
            "",
            "spikes of an instrument: kept and told, or removed and filled (harmonic)",
        ),
    ] = "keep"
    form: Annotated[
        Literal[0, 1, 2] | None,
        entry(
            "", "order of the polynomial that is removed: 0 mean, 1 tilt, 2 curvature"
        ),
    ] = None
    longest_wavelength: Annotated[
        Real | None, entry("m", "longer waves are removed", gt=0)
    ] = None
    shortest_wavelength: Annotated[
        Real | None, entry("m", "shorter waves are removed", gt=0)
    ] = None

    def __post_init__(self: Any) -> None:
        super().__post_init__()
        if self.form is not None:
            form = number("form", self.form, "0, 1 or 2", lambda v: v in (0, 1, 2))
            set_frozen(self, form=int(form))
        longest, shortest = self.longest_wavelength, self.shortest_wavelength
        if longest is not None and shortest is not None and not shortest < longest:
            raise InvalidScene(
                f"shortest_wavelength is {shortest:g} m, but must be below longest_wavelength = "
                f"{longest:g} m"
            )

    @property
    def steps(self: Any) -> str:
        """The steps as a part of a fingerprint."""
        words: str = f"{self.treatment}/2"
        for name in (
            "missing",
            "outliers",
            "form",
            "longest_wavelength",
            "shortest_wavelength",
        ):
            if getattr(self, name) not in (None, "refuse", "keep"):
                words += f" {name}={getattr(self, name)!r}"
        return words


def prepared(
    given: NDArray[Any],
    recipe: Any,
    where: str,
    notes: Iterable[str] = (),
    unit: float = 1.0,
    filled_before: NDArray[np.bool_] | None = None,
) -> Surface:
    """Treat a recipe's heights, NaN where missing and in `unit` of metres.  Raises
    InvalidScene.  The mask `filled` of the surface marks the heights that are filled
    here and those that were filled before.
    """
    heights = np.multiply(given, unit, dtype=np.float64, order="C")
    require_usable(heights, where, recipe.missing)
    said = [*warn_user(levels_note(given.dtype)), *notes, *_mark_notes(heights, unit)]
    if (spikes := outliers(heights)).any():
        said += _spike_notes(heights, spikes, recipe)
        if recipe.outliers == "remove":
            heights[spikes] = np.nan
    largest = float(np.nanmax(np.abs(heights)))
    order, why = recipe.form, ""
    if order is None and recipe.treatment == "mirrored":
        order = 1
    elif order is None and recipe.treatment == "periodic":
        whole = filled(heights, "nearest") if np.isnan(heights).any() else heights
        level = edge_jumps(form_removed(whole, 1))
        both = zip(edge_jumps(whole), level, strict=True)
        if any(_jumping([was]) and now[0] < was[0] / 2 for was, now in both):
            order, why = 1, ", because its tilt makes the edges jump; form = 0 keeps it"
    if order is not None:
        heights = form_removed(heights, order)
        said.append(f"{_FORMS[order]} removed{why}")
    if 0 < np.nanstd(heights) < ROUNDING * largest:
        heights = np.where(np.isnan(heights), np.nan, 0.0)
        said.append("what is left is rounding, so that the surface is flat")
    replaced = np.isnan(heights)
    if replaced.any():
        heights, told = _with_fill(heights, given, recipe.missing)
        said += told
    if filled_before is not None:
        replaced |= filled_before
    jumps = edge_jumps(heights)
    said.append(f"rms jump at the edges: {_jump_words(jumps)}")
    if recipe.treatment == "refuse" and _jumping(jumps):
        remedy = '"mirrored", which mirrors the map at its edges, or to "periodic" to take it as it is'
        raise InvalidScene(
            f"{where}: not periodic, {said[-1]}; set treatment to {remedy}"
        )
    periods = recipe.periods
    treated = recipe.treatment == "mirrored" or bool(why) or _jumping(jumps)
    if recipe.treatment == "mirrored":
        after = [(0, n) for n in heights.shape]
        heights = np.pad(heights, after, mode="symmetric")
        replaced = np.pad(replaced, after, mode="symmetric")
        periods = tuple(2 * p for p in periods)
        said.append(
            "mirrored at its edges, so that the period is twice the map each way"
        )
    limits = {
        "longer": recipe.longest_wavelength,
        "shorter": recipe.shortest_wavelength,
    }
    if bounds := [
        f"{word} than {length:.3g} m" for word, length in limits.items() if length
    ]:
        low, high = (
            2 * math.pi / length if length else None for length in limits.values()
        )
        heights = kept_waves(heights, periods, high or math.inf, low or 0.0)
        said.append(f"waves {' and '.join(bounds)} removed")
    heights.flags.writeable = False
    known = {
        "shortest_wavelength": recipe.shortest_wavelength,
        "recipe": recipe.fingerprint,
        "filled": replaced,
    }
    return _with_doubts(
        Surface(heights, periods, notes=tuple(said), **known), recipe, treated
    )


def _with_fill(
    heights: FloatArray, given: NDArray[Any], missing: str
) -> tuple[FloatArray, list[str]]:
    """Return the heights without holes, and a note if some were missing in the map
    itself.

    Where missing heights are refused, the only holes are those of removed outliers,
    which are filled harmonically.
    """
    method = "harmonic" if missing == "refuse" else missing
    absent = int(np.count_nonzero(np.isnan(given)))
    percent = f"{100 * absent / heights.size:.2g} %"
    note = f"{absent} of {heights.size} heights missing ({percent}), filled by the method {method}"
    return filled(heights, method), [note] if absent else []


def _with_doubts(surface: Surface, recipe: Any, treated: bool) -> Surface:
    """Add notes on the slopes of a map, and what the treatment of its edges may
    change.
    """
    inside = inner_moments(surface)
    said = [*surface.notes, *_slope_notes(surface, inside.rms_slope)]
    if not treated or inside.rms_curvature == 0:
        return replace(surface, notes=tuple(said))
    length = inside.rms_slope / inside.rms_curvature / min(recipe.periods)
    falling = {
        name: length * times for name, times in EDGE_ERRORS[recipe.treatment].items()
    }
    shares = falling | EDGE_SHARES[recipe.treatment]
    each = ", ".join(
        f"{n.replace('_', ' ')} {100 * s:.3g} %" for n, s in shares.items()
    )
    told = f"the treatment of the edges, {recipe.treatment}, changes in nine of ten maps by up to"
    said.append(
        f"{told} (areas of the total one): {each}; this is a part of the error of each"
    )
    return replace(surface, notes=tuple(said), treatment_errors=shares)


def _slope_notes(surface: Surface, slope: float) -> Iterator[str]:
    """Yield the rms slopes of a map where they differ, that of its spectrum without
    jumps first.
    """
    by_steps, with_edges = surface.rms_slope, surface_moments(surface).rms_slope
    if not math.isclose(slope, by_steps, rel_tol=0.01):
        of_waves = (
            f"rms slope {slope:.4g} of the spectrum, which an effective hardness takes"
        )
        yield f"{of_waves}, and {by_steps:.4g} from differences of neighbours"
    if with_edges != slope:
        yield (
            f"the jumps at the edges make the rms slope of the spectrum {with_edges:.4g}, which a "
            'theory of spectrum = "surface" takes; treatment = "mirrored" has no jumps'
        )


def _mark_notes(heights: FloatArray, unit: float) -> Iterator[str]:
    """Yield a warning of a height, far from all others, that may mark missing ones
    (-9999).
    """
    for mark in (np.nanmin(heights), np.nanmax(heights)):
        marked = heights == mark
        rest = heights[~marked & ~np.isnan(heights)]
        count = int(np.count_nonzero(marked))
        if count >= 2 and rest.size and 0 < np.ptp(rest) < np.abs(rest - mark).min():
            told = f"{count} heights are {mark / unit:.6g}, far from all others"
            yield f"{told}; if this marks points without a height, write NaN in its place"


def outliers(heights: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the spikes, at most two points wide, of heights, NaN where
    missing.
    """
    from scipy import ndimage

    whole = filled(heights, "nearest") if np.isnan(heights).any() else heights
    steps = [np.abs(np.diff(whole, axis=axis)).ravel() for axis in range(whole.ndim)]
    usual = float(np.percentile(np.concatenate(steps), 99))
    away = np.abs(whole - ndimage.median_filter(whole, 3, mode="mirror"))
    found = away > SPIKE * usual
    if usual == 0 or not found.any() or min(whole.shape) < 4:
        return np.zeros(whole.shape, bool)
    ring = np.ones((7,) * whole.ndim, bool)
    ring[(slice(2, 5),) * whole.ndim] = False
    padded = np.pad(whole, 3, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, ring.shape)[found][
        :, ring
    ]
    low, high = np.percentile(around, (10, 90), axis=1)
    found[found] = away[found] > SPREAD * (high - low)
    return np.asarray(found & ~np.isnan(heights))


def _spike_notes(
    heights: FloatArray, spikes: NDArray[np.bool_], recipe: Any
) -> Iterator[str]:
    """Yield how many outliers there are, where, and what becomes of them; warn if they
    stay.
    """
    spacing = np.divide(recipe.periods, heights.shape)
    first = (np.argwhere(spikes)[:6] * spacing).tolist()
    places = [f"({', '.join(f'{x:.3g}' for x in place)})" for place in first]
    count = int(spikes.sum())
    where = f"{', '.join(places)}{f' and {count - 6} more' if count > 6 else ''}"
    what = f"{count} of {heights.size} heights are outliers, spikes far above or below all around: "
    if recipe.outliers == "remove":
        yield f"{what}removed, at {where} m"
    else:
        kept = f"at {where} m; the contact sees them as roughness: if they are the instrument's, "
        yield from warn_user((f'{what}{kept}set outliers to "remove"',))


def form_removed(heights: FloatArray, order: int) -> FloatArray:
    """Subtract the least-squares polynomial of total order 0, 1 or 2, to which NaN do
    not count.
    """
    left = heights.reshape(len(heights), -1).copy()
    known = ~np.isnan(left)
    x, y = (
        np.polynomial.legendre.legvander(np.linspace(-1, 1, n), order)
        for n in left.shape
    )
    orders = np.arange(order + 1)
    kept = orders[:, None] + orders <= order
    normal = np.einsum("xi,xk,xy,yj,yl->ijkl", x, x, known * 1.0, y, y, optimize=True)
    table = np.zeros(kept.shape)
    for _ in range(2):  # the second pass removes what rounding left of a large form
        moments = x.T @ np.where(known, left, 0.0) @ y
        table[kept] = np.linalg.lstsq(normal[kept][:, kept], moments[kept])[0]
        left -= x @ table @ y.T
    return left.reshape(heights.shape)


def filled(heights: FloatArray, method: str) -> FloatArray:
    """Give every NaN a height by the method "nearest" or "harmonic", the mean of its
    neighbours.
    """
    from scipy import ndimage, sparse

    absent = np.isnan(heights)
    if method == "nearest":
        _, nearest = ndimage.distance_transform_edt(absent, return_indices=True)
        return np.asarray(heights[tuple(nearest)])
    holes = np.argwhere(absent)
    numbers = np.full(heights.shape, -1)
    numbers[absent] = np.arange(len(holes))
    neighbours, right = np.zeros((2, len(holes)))
    links: Any = sparse.csc_matrix((len(holes), len(holes)))
    for axis, step in itertools.product(range(heights.ndim), (-1, 1)):
        beside = holes + step * (np.arange(heights.ndim) == axis)
        inside = (beside[:, axis] >= 0) & (beside[:, axis] < heights.shape[axis])
        own, place = np.flatnonzero(inside), tuple(beside[inside].T)
        neighbours[own] += 1
        right[own] += np.nan_to_num(heights[place])
        open_ = numbers[place] >= 0
        pairs = (own[open_], numbers[place][open_])
        links += sparse.csc_matrix((np.ones(pairs[0].size), pairs), links.shape)
    result = heights.copy()
    result[absent] = sparse.linalg.spsolve(
        (sparse.diags(neighbours) - links).tocsc(), right
    )
    return result


def edge_jumps(heights: FloatArray) -> list[tuple[float, float]]:
    """Return for each axis the rms jump at the edge and the largest between
    neighbouring rows.
    """
    jumps = []
    for axis in range(heights.ndim):
        edge = np.take(heights, 0, axis) - np.take(heights, -1, axis)
        steps = np.diff(heights, axis=axis)
        steps *= steps
        inner = steps if heights.ndim == 1 else steps.mean(axis=1 - axis)
        jumps.append((math.sqrt(np.mean(edge * edge)), math.sqrt(inner.max())))
    return jumps


def _jumping(jumps: list[tuple[float, float]]) -> bool:
    return any(edge > LARGEST_JUMP * inner for edge, inner in jumps)


def _jump_words(jumps: list[tuple[float, float]]) -> str:
    return " and ".join(
        f"{edge:.3g} m across {axis} (between neighbours at most {inner:.3g} m)"
        for axis, (edge, inner) in zip("xy", jumps, strict=False)
    )
