"""What is done to a measured map before it is a surface: holes, form, edges, band.

A map is treated in this order, and a sentence on each step is among the notes of its surface:

1. a least-squares polynomial (`form`) is removed, fitted to the points that have a height;
2. points without a height (NaN) are filled;
3. a map that is not periodic is tapered at its edges, if the user asks for it;
4. waves outside a band are removed.

Every method here is periodic, but a measured map rarely is: its heights jump across its edges.  The
jump at the edge of an axis is the rms difference of its last and first rows.  On a periodic map
these two are neighbours like any others.  So a map counts as not periodic if the jump is more than
`LARGEST_JUMP` times the largest rms difference of two neighbouring rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Surface, check_extremes, number, positive, rms_slope, settle
from epcontact.surfaces.filters import kept_waves
from epcontact.surfaces.recipe import Real

Treatment = Literal["refuse", "periodic", "detrend_and_window"]
Missing = Literal["refuse", "nearest", "harmonic"]
Order = Literal[0, 1, 2]

#: Edge jump over the largest jump between neighbours, above which a map counts as not periodic.
LARGEST_JUMP = 2.0
_FORMS = {0: "mean height", 1: "least-squares plane", 2: "least-squares quadratic form"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Preparation:
    """The steps that a recipe of measured heights can ask for.

    Args:
        missing: points without a height: "refuse" refuses them; "nearest" gives each the height of
            the nearest point that has one; "harmonic" spans holes by the solution of Laplace's
            equation, like a soap film.
        form: order of the polynomial that is removed: 0 the mean, 1 a plane (tilt), 2 a quadratic
            form (tilt and curvature); None: 1 before a window, otherwise nothing.
        longest_wavelength, shortest_wavelength: in m; longer and shorter waves are removed.
    """

    missing: Annotated[
        Missing, Field(description="points without a height: refused, or filled by this method")
    ] = "refuse"
    form: Annotated[
        Order | None,
        Field(description="order of the polynomial that is removed: 0 mean, 1 tilt, 2 curvature"),
    ] = None
    longest_wavelength: Annotated[
        Real | None, Field(gt=0, description="m; longer waves are removed")
    ] = None
    shortest_wavelength: Annotated[
        Real | None, Field(gt=0, description="m; shorter waves are removed")
    ] = None


def check_preparation(recipe: Any) -> None:
    """Set a recipe's numbers; raise InvalidScene if a step is none of those above."""
    words = {"treatment": Treatment, "missing": Missing}
    for name, known in words.items():
        if getattr(recipe, name) not in known.__args__:  # type: ignore[attr-defined]
            allowed = ", ".join(known.__args__)  # type: ignore[attr-defined]
            raise InvalidScene(f"{name} is {getattr(recipe, name)!r}, but must be one of {allowed}")
    if recipe.form is not None:
        settle(recipe, form=int(number("form", recipe.form, "0, 1 or 2", lambda v: v in (0, 1, 2))))
    right = "a share of the period above 0 and up to 0.5"
    settle(recipe, taper=number("taper", recipe.taper, right, lambda v: 0 < v <= 0.5))
    for name in ("longest_wavelength", "shortest_wavelength"):
        if (value := getattr(recipe, name)) is not None:
            settle(recipe, **{name: positive(name, value, "m")})
    longest, shortest = recipe.longest_wavelength, recipe.shortest_wavelength
    if longest is not None and shortest is not None and not shortest < longest:
        raise InvalidScene(
            f"shortest_wavelength is {shortest:g} m, but must be below longest_wavelength = "
            f"{longest:g} m"
        )


def preparation_words(recipe: Any) -> str:
    """Return the steps of a recipe as a part of its fingerprint."""
    words: str = recipe.treatment
    if recipe.treatment == "detrend_and_window":
        words = f"detrend_and_window/2 taper={recipe.taper!r}"
    for name in ("missing", "form", "longest_wavelength", "shortest_wavelength"):
        if getattr(recipe, name) not in (None, "refuse"):
            words += f" {name}={getattr(recipe, name)!r}"
    return words


def prepared(heights: FloatArray, recipe: Any, where: str, told: tuple[str, ...] = ()) -> Surface:
    """Treat a recipe's own writable heights, NaN where missing, and return the surface.

    Its notes begin with `told`.

    Raises:
        InvalidScene: if heights are missing, or jump at the edges, and no remedy is chosen.
    """
    require_measured(heights, recipe.missing, where)
    notes = [*told, *_mark_notes(heights, getattr(recipe, "unit", None) or 1.0)]
    window = recipe.treatment == "detrend_and_window"
    order = recipe.form if recipe.form is not None else 1 if window else None
    if order is not None:
        heights = form_removed(heights, order)
        notes.append(f"{_FORMS[order]} removed")
    absent = int(np.count_nonzero(np.isnan(heights)))
    if absent:
        heights = filled(heights, recipe.missing)
        notes.append(
            f"{absent} of {heights.size} heights missing ({100 * absent / heights.size:.2g} %), "
            f"filled by the method {recipe.missing}"
        )
    jumps = edge_jumps(heights)
    words = f"rms jump at the edges: {_jump_words(jumps)}"
    if window:
        spacing = tuple(p / n for p, n in zip(recipe.periods, heights.shape, strict=True))
        before = _rms(heights - heights.mean())
        heights, factor = windowed(heights, recipe.taper, spacing)
        words = (
            f"tapered over {recipe.taper:g} of the period at each edge and multiplied by "
            f"{factor:.4g} to keep the rms slope (rms height {before:.3g} m before, "
            f"{_rms(heights):.3g} m after); {words} before, {_jump_words(edge_jumps(heights))} "
            "after"
        )
    elif recipe.treatment == "refuse" and any(a > LARGEST_JUMP * b for a, b in jumps):
        raise InvalidScene(
            f"{where}: not periodic, {words}; set treatment to detrend_and_window, or to periodic "
            "to take it as it is"
        )
    heights, removed = _in_band(heights, recipe)
    heights.flags.writeable = False
    return Surface(
        heights,
        recipe.periods,
        shortest_wavelength=recipe.shortest_wavelength,
        recipe=recipe.fingerprint,
        notes=(*notes, words, *removed),
    )


def _mark_notes(heights: FloatArray, unit: float) -> Iterator[str]:
    """Yield a warning of a lowest or highest height that looks like the mark of missing ones.

    Instruments write -9999, say: one value, several times, apart from the others by more than all
    they span.  It is shown in `unit`, that of the file in m.
    """
    for mark in (np.nanmin(heights), np.nanmax(heights)):
        marked = heights == mark
        count = int(np.count_nonzero(marked))
        if count < 2:
            continue
        rest = heights[~marked & ~np.isnan(heights)]
        if rest.size and 0 < np.ptp(rest) < np.abs(rest - mark).min():
            yield (
                f"{count} heights are {mark / unit:.6g}, far from all others; if this marks points "
                "without a height, write NaN in its place"
            )


def _in_band(heights: FloatArray, recipe: Any) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the heights without the waves outside the recipe's band, and a note on them."""
    longest, shortest = recipe.longest_wavelength, recipe.shortest_wavelength
    if longest is None and shortest is None:
        return heights, ()
    high = math.inf if shortest is None else 2 * math.pi / shortest
    low = 0.0 if longest is None else 2 * math.pi / longest
    limits = [] if longest is None else [f"longer than {longest:.3g} m"]
    limits += [] if shortest is None else [f"shorter than {shortest:.3g} m"]
    note = f"waves {' and '.join(limits)} removed"
    return kept_waves(heights, recipe.periods, high, low), (note,)


def require_measured(heights: NDArray[Any], missing: str, where: str) -> None:
    """Raise InvalidScene if heights are infinite, too large to square, or missing and not filled.

    Args:
        heights: the heights, NaN where there is none.
        missing: how missing ones are filled; "refuse" if they are not.
        where: the name of the heights in the message.
    """
    if np.isfinite(low := heights.min()) and np.isfinite(high := heights.max()):
        extremes = (low, high)
    else:
        known = heights[~np.isnan(heights)]
        if known.size == 0:
            raise InvalidScene(f"{where}: {heights.size} of {heights.size} heights are NaN")
        if not np.isfinite(known).all():
            bad = int(np.count_nonzero(~np.isfinite(known)))
            raise InvalidScene(
                f"{where}: {bad} of {heights.size} heights are infinite; mark them as missing by "
                "NaN"
            )
        if missing == "refuse":
            raise InvalidScene(
                f"{where}: {heights.size - known.size} of {heights.size} heights are NaN or "
                'masked; set missing to "harmonic" or "nearest" to fill them, or crop the map'
            )
        extremes = (known.min(), known.max())
    check_extremes(float(extremes[0]), float(extremes[1]), where)


def form_removed(heights: FloatArray, order: int) -> FloatArray:
    """Subtract the least-squares polynomial of total order `order`; NaN are left out of the fit.

    Args:
        heights: (nx, ny) or (nx,), in m.
        order: 0, 1 or 2.

    Example:
        >>> tilted = np.array([[0.0, 1.0, 2.0], [3.0, np.nan, 5.0]])
        >>> bool(np.nanmax(np.abs(form_removed(tilted, 1))) < 1e-15)
        True
    """
    grid = heights.reshape(len(heights), -1)
    known = ~np.isnan(grid)
    # Products of Legendre polynomials over the map, which are nearly orthogonal on its points.
    x, y = (
        np.polynomial.legendre.legvander(np.linspace(-1, 1, n) if n > 1 else np.zeros(1), order)
        for n in grid.shape
    )
    terms = [
        (i, j)
        for i in range(order + 1)
        for j in range(order + 1 - i)
        if j == 0 or grid.shape[1] > 1
    ]
    weights = known.astype(np.float64)
    left = grid.copy()
    for _ in range(2):  # the second pass removes what rounding left of a large form
        flat = np.where(known, left, 0.0)
        normal = [[(x[:, i] * x[:, k]) @ weights @ (y[:, j] * y[:, m]) for k, m in terms]
                  for i, j in terms]  # fmt: skip
        moments = [x[:, i] @ flat @ y[:, j] for i, j in terms]
        coefficients = np.linalg.lstsq(np.array(normal), np.array(moments))[0]
        table = np.zeros((order + 1, order + 1))
        for (i, j), coefficient in zip(terms, coefficients, strict=True):
            table[i, j] = coefficient
        left -= x @ table @ y.T
    return left.reshape(heights.shape)


def filled(heights: FloatArray, method: str) -> FloatArray:
    """Give every NaN a height.

    Args:
        heights: (nx, ny) or (nx,), at least one of them no NaN.
        method: "nearest" or "harmonic"; see `Preparation`.

    Example:
        >>> filled(np.array([1.0, np.nan, np.nan, 4.0]), "harmonic")
        array([1., 2., 3., 4.])
    """
    from scipy import ndimage, sparse

    absent = np.isnan(heights)
    if method == "nearest":
        nearest = ndimage.distance_transform_edt(
            absent, return_distances=False, return_indices=True
        )
        return np.asarray(heights[tuple(nearest)])
    number = np.full(heights.shape, -1)
    number[absent] = np.arange(absent.sum())
    pairs, neighbours = [], np.zeros(int(absent.sum()))
    right = np.zeros_like(neighbours)
    for axis in range(heights.ndim):
        for here, there in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            # At the edge of the map a hole has no neighbour: the film meets it at a right angle.
            here_, there_ = ([slice(None)] * heights.ndim for _ in range(2))
            here_[axis], there_[axis] = here, there
            own, other = number[tuple(here_)], number[tuple(there_)]
            hole = own >= 0
            np.add.at(neighbours, own[hole], 1.0)
            rim = hole & (other < 0)
            np.add.at(right, own[rim], heights[tuple(there_)][rim])
            both = hole & (other >= 0)
            pairs.append([own[both], other[both]])
    rows, columns = np.concatenate(pairs, axis=1)
    links = sparse.coo_matrix((np.ones(rows.size), (rows, columns)), (right.size,) * 2)
    result = heights.copy()
    result[absent] = sparse.linalg.spsolve((sparse.diags(neighbours) - links).tocsc(), right)
    return result


def windowed(
    heights: FloatArray, taper: float, spacing: tuple[float, ...]
) -> tuple[FloatArray, float]:
    """Taper heights to zero at the edges, and restore their rms slope.

    The window rises as (1 - cos) / 2 over `taper` of each period and falls likewise (Tukey's
    window; Hann's for taper = 0.5).  It flattens the roughness, so all heights are then multiplied
    by a factor that restores the rms slope, by which the contact area goes, rather than the rms
    height.

    Args:
        heights: (nx, ny) or (nx,) in m.
        taper: share of each period.
        spacing: distance of points along each direction, in m.

    Returns:
        The heights, with zero mean, and the factor.
    """
    before = rms_slope(heights, spacing)
    heights = heights - heights.mean()
    for axis, n in enumerate(heights.shape):
        heights *= _window(n, taper).reshape([-1 if a == axis else 1 for a in range(heights.ndim)])
    heights -= heights.mean()
    after = rms_slope(heights, spacing)
    factor = before / after if after > 0 else 1.0
    return heights * factor, factor


def edge_jumps(heights: FloatArray) -> list[tuple[float, float]]:
    """Return for each axis the rms jump at the edge and the largest between neighbouring rows.

    `heights` has the shape (nx, ny) or (nx,); the jumps are in its unit.
    """
    return [_axis_jumps(heights, axis) for axis in range(heights.ndim)]


def _axis_jumps(heights: FloatArray, axis: int) -> tuple[float, float]:
    edge = np.take(heights, 0, axis) - np.take(heights, -1, axis)
    steps = np.diff(heights, axis=axis)
    steps *= steps
    inner = steps if heights.ndim == 1 else steps.mean(axis=1 - axis)
    return math.sqrt(np.mean(edge * edge)), math.sqrt(inner.max())


def _rms(heights: FloatArray) -> float:
    return math.sqrt(float(np.vdot(heights, heights)) / heights.size)


def _window(n: int, taper: float) -> FloatArray:
    """Return Tukey's window at n points; its zero is midway between the last and the first."""
    distance = (np.arange(n) + 0.5) / n
    rise = np.minimum(np.minimum(distance, 1 - distance) / taper, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * rise))


def _jump_words(jumps: list[tuple[float, float]]) -> str:
    return " and ".join(
        f"{edge:.3g} m across {axis} (between neighbours at most {inner:.3g} m)"
        for axis, (edge, inner) in zip("xy", jumps, strict=False)
    )
