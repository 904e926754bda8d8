"""The treatment that makes a measured map a surface: holes, form, edges, band.

A map is treated in this order, and a sentence on each step is among the notes of its surface:

1. a least-squares polynomial (`form`) is removed, fitted to the points that have a height;
2. points without a height (NaN) are filled;
3. a map that is not periodic is tapered at its edges, if the user asks for it;
4. waves outside a band are removed.

Every method here is periodic, but a measured map rarely is: its heights jump across its edges.  A
map counts as not periodic if the rms difference of its last and first rows is more than
`LARGEST_JUMP` times the largest one of two neighbouring rows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import (
    Surface,
    cautioned,
    levels_note,
    number,
    require_known,
    rms_slope,
    settle,
)
from epcontact.surfaces.power_spectrum import kept_waves
from epcontact.surfaces.recipe import Fields, Real, entry

Treatment = Literal["refuse", "periodic", "detrend_and_window"]
EdgeField = Annotated[
    Treatment, entry("", "a map that is not periodic: refused, taken as it is, or made periodic")
]
TaperField = Annotated[Real, entry("", "share of a period over which the window rises, and falls")]

#: Edge jump over the largest jump between neighbours, above which a map counts as not periodic.
LARGEST_JUMP = 2.0
_FORMS = {0: "mean height", 1: "least-squares plane", 2: "least-squares quadratic form"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Preparation(Fields):
    """The steps that a recipe of measured heights can ask for, beside `treatment` and `taper`.

    Missing heights are those of the nearest points ("nearest"), or span a hole like a soap film
    ("harmonic", the solution of Laplace's equation).  Before a window, `form` is 1 by default.
    """

    missing: Annotated[
        Literal["refuse", "nearest", "harmonic"],
        entry("", "points without a height: refused, or filled by this method"),
    ] = "refuse"
    form: Annotated[
        Literal[0, 1, 2] | None,
        entry("", "order of the polynomial that is removed: 0 mean, 1 tilt, 2 curvature"),
    ] = None
    longest_wavelength: Annotated[Real | None, entry("m", "longer waves are removed", gt=0)] = None
    shortest_wavelength: Annotated[Real | None, entry("m", "shorter waves are removed", gt=0)] = (
        None
    )

    def __post_init__(self: Any) -> None:
        super().__post_init__()
        if self.form is not None:
            form = number("form", self.form, "0, 1 or 2", lambda v: v in (0, 1, 2))
            settle(self, form=int(form))
        right = "a share of the period above 0 and up to 0.5"
        settle(self, taper=number("taper", self.taper, right, lambda v: 0 < v <= 0.5))
        longest, shortest = self.longest_wavelength, self.shortest_wavelength
        if longest is not None and shortest is not None and not shortest < longest:
            raise InvalidScene(
                f"shortest_wavelength is {shortest:g} m, but must be below longest_wavelength = "
                f"{longest:g} m"
            )

    @property
    def steps(self: Any) -> str:
        """The steps as a part of a fingerprint."""
        words: str = self.treatment
        if words == "detrend_and_window":
            words += f"/2 taper={self.taper!r}"
        for name in ("missing", "form", "longest_wavelength", "shortest_wavelength"):
            if getattr(self, name) not in (None, "refuse"):
                words += f" {name}={getattr(self, name)!r}"
        return words


def prepared(
    given: NDArray[Any], recipe: Any, where: str, notes: Iterable[str] = (), unit: float = 1.0
) -> Surface:
    """Treat a recipe's heights, NaN where missing and in `unit` of metres; return the surface.
    Raises InvalidScene if heights are missing, or jump at the edges, and no remedy is chosen."""
    heights = np.multiply(given, unit, dtype=np.float64)
    require_known(heights, where, recipe.missing)
    said = [*cautioned(levels_note(given.dtype)), *notes, *_mark_notes(heights, unit)]
    order = 1 if recipe.treatment == "detrend_and_window" else None
    order = order if recipe.form is None else recipe.form
    if order is not None:
        heights = form_removed(heights, order)
        said.append(f"{_FORMS[order]} removed")
    if absent := int(np.count_nonzero(np.isnan(heights))):
        heights = filled(heights, recipe.missing)
        said.append(
            f"{absent} of {heights.size} heights missing ({100 * absent / heights.size:.2g} %), "
            f"filled by the method {recipe.missing}"
        )
    heights, words = _joined(heights, recipe, where)
    said.append(words)
    limits = {"longer": recipe.longest_wavelength, "shorter": recipe.shortest_wavelength}
    if bounds := [f"{word} than {length:.3g} m" for word, length in limits.items() if length]:
        low, high = (2 * math.pi / length if length else None for length in limits.values())
        heights = kept_waves(heights, recipe.periods, high or math.inf, low or 0.0)
        said.append(f"waves {' and '.join(bounds)} removed")
    heights.flags.writeable = False
    known = {"shortest_wavelength": recipe.shortest_wavelength, "recipe": recipe.fingerprint}
    return Surface(heights, recipe.periods, notes=tuple(said), **known)


def _mark_notes(heights: FloatArray, unit: float) -> Iterator[str]:
    """Yield a warning of a lowest or highest height that looks like the mark of missing ones.
    Instruments write -9999, say (in their `unit`, in m): one value, several times, apart from the
    others by more than all they span."""
    for mark in (np.nanmin(heights), np.nanmax(heights)):
        marked = heights == mark
        rest = heights[~marked & ~np.isnan(heights)]
        count = int(np.count_nonzero(marked))
        if count >= 2 and rest.size and 0 < np.ptp(rest) < np.abs(rest - mark).min():
            yield (
                f"{count} heights are {mark / unit:.6g}, far from all others; if this marks points "
                "without a height, write NaN in its place"
            )


def form_removed(heights: FloatArray, order: int) -> FloatArray:
    """Subtract the least-squares polynomial of total order 0, 1 or 2; NaN are left out of the fit.
    Products of Legendre's polynomials are nearly orthogonal on the map."""
    left = heights.reshape(len(heights), -1).copy()
    known = ~np.isnan(left)
    x, y = (np.polynomial.legendre.legvander(np.linspace(-1, 1, n), order) for n in left.shape)
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
    """Give every NaN a height by the method "nearest" or "harmonic"; at least one is no NaN.  A
    harmonic film has at each hole the mean of its neighbours in the map, which are fewer at the
    edge: there the film meets the edge at a right angle."""
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
    result[absent] = sparse.linalg.spsolve((sparse.diags(neighbours) - links).tocsc(), right)
    return result


def _joined(heights: FloatArray, recipe: Any, where: str) -> tuple[FloatArray, str]:
    """Make heights periodic as the recipe asks, and say how they jump at the edges."""
    jumps = edge_jumps(heights)
    words = f"rms jump at the edges: {_jump_words(jumps)}"
    if recipe.treatment == "detrend_and_window":
        before = heights.std()
        spacing = tuple(p / n for p, n in zip(recipe.periods, heights.shape, strict=True))
        heights, factor = windowed(heights, recipe.taper, spacing)
        words = (
            f"tapered over {recipe.taper:g} of the period at each edge and multiplied by "
            f"{factor:.4g} to keep the rms slope (rms height {before:.3g} m before, "
            f"{heights.std():.3g} m after); {words} before, {_jump_words(edge_jumps(heights))} "
            "after"
        )
    elif recipe.treatment == "refuse" and any(a > LARGEST_JUMP * b for a, b in jumps):
        raise InvalidScene(
            f"{where}: not periodic, {words}; set treatment to detrend_and_window, or to periodic "
            "to take it as it is"
        )
    return heights, words


def windowed(
    heights: FloatArray, taper: float, spacing: tuple[float, ...]
) -> tuple[FloatArray, float]:
    """Taper heights to zero at the edges and restore their rms slope; return the factor, too.  The
    zero of Tukey's window is midway between the last point and the first.  It flattens the
    roughness, so all heights are then multiplied by a factor that restores the rms slope, by which
    the contact area goes, rather than the rms height."""
    from scipy.signal.windows import tukey

    before = rms_slope(heights, spacing)
    windows = np.ix_(*(tukey(2 * n + 1, 2 * taper)[1::2] for n in heights.shape))
    heights = math.prod(windows, start=heights - heights.mean())
    heights -= heights.mean()
    after = rms_slope(heights, spacing)
    factor = before / after if after > 0 else 1.0
    return heights * factor, factor


def edge_jumps(heights: FloatArray) -> list[tuple[float, float]]:
    """Return for each axis the rms jump at the edge and the largest between neighbouring rows."""
    jumps = []
    for axis in range(heights.ndim):
        edge = np.take(heights, 0, axis) - np.take(heights, -1, axis)
        steps = np.diff(heights, axis=axis)
        steps *= steps
        inner = steps if heights.ndim == 1 else steps.mean(axis=1 - axis)
        jumps.append((math.sqrt(np.mean(edge * edge)), math.sqrt(inner.max())))
    return jumps


def _jump_words(jumps: list[tuple[float, float]]) -> str:
    return " and ".join(
        f"{edge:.3g} m across {axis} (between neighbours at most {inner:.3g} m)"
        for axis, (edge, inner) in zip("xy", jumps, strict=False)
    )
