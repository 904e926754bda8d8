"""Charts of the study of P(sigma) at its ends; what they show is defined in `pressures`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.curves import observed_order
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.output.charts.style import CYCLE
from epcontact.studies import paper_scene as scenes
from epcontact.studies.pressures import (
    BINS,
    DENSITY,
    ENDS,
    MEAN_SLOPE,
    RAW_SLOPE,
    WINDOW,
    WINDOWS,
    Ends,
)

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart


def draw_ends(found: Ends) -> tuple[Chart, ...]:
    """P(sigma), its ends, its slopes there (raw, corrected), and the latter against the window."""
    told = (
        f"of {found.values.shape[0]} surfaces of the paper's roughness, 1/{found.bandwidth} of "
        "the longest wave being the shortest, material and load, capped, by boundary elements, in "
        "units of the hardness"
    )
    grids = (
        f"at {', '.join(f'{n:g}' for n in found.points)} points per shortest wavelength, with its "
        "limit for ever finer grids (open marks, at 0), as means with 95 % intervals"
    )
    slope = rf"slope within {WINDOW:g} of the end, $P'\,\sigma_\mathrm{{P}}^2$ (–)"
    return (
        _draw_densities(found, told),
        _draw_limits(
            found,
            DENSITY,
            y=r"density at the end, $P\,\sigma_\mathrm{P}$ (–)",
            column="relative_density",
            caption="Density of the pressure at 0+ and at hardness- as the raw grid shows it, "
            f"{told}, {grids}; the theory has zero. {_vanishing(found)}",
        ),
        _draw_limits(
            found,
            RAW_SLOPE,
            y=slope,
            column="relative_slope",
            caption=f"Slope of the density of the pressure as the raw grid shows it, of the line "
            f"through the points within {WINDOW:g} of either end, {told}, {grids}, beside the "
            f"theory's. {_slopes_told(found, RAW_SLOPE)}",
        ),
        _draw_limits(
            found,
            MEAN_SLOPE,
            y=slope,
            column="relative_slope",
            caption="Mean slope of the density of the pressure in the continuum limit, 2 F/w² of "
            f"the corrected area F within w = {WINDOW:g} of either end, {told}, {grids}, beside "
            f"the theory's. {_slopes_told(found, MEAN_SLOPE)}",
        ),
        _draw_windows(found, told),
    )


def _draw_densities(found: Ends, told: str) -> Chart:
    series = [
        Series(name if name == "persson" else f"{name} a wavelength", *pair, line=True)
        for name, pair in found.densities.items()
    ]
    return curves(
        series,
        x=r"contact pressure over hardness, $\sigma / \sigma_\mathrm{P}$ (–)",
        y=r"density $P(\sigma)\,\sigma_\mathrm{P}$ (–)",
        columns=("relative_pressure", "relative_density"),
        caption=f"Density of the pressure in elastic contact {told}: raw, by points per shortest "
        f"wavelength, mean of {BINS} bins and of the surfaces, beside the density of the theory "
        f"(gamma = {scenes.GAMMA}) with the spectrum of the same surfaces.",
        limits={"ylim": (0, None), "xlim": (0, 1)},
    )


def _draw_limits(found: Ends, figure: int, *, y: str, column: str, caption: str) -> Chart:
    """A figure of both ends against the root of the spacing, with limits at 0, and the theory's."""
    spacing, series, colours = 1 / np.sqrt(found.points), list[Series](), dict[str, str]()
    for end, name in enumerate(ENDS):
        one = found.limit(end, figure)
        limit, error = one.limit, one.error
        own = [
            Series(name, spacing, one.mean, one.mean - one.half_width, one.mean + one.half_width),
            Series(f"{name}, limit", [0.0], [limit], [limit - error], [limit + error]),
        ]
        if figure != DENSITY:
            level = [found.theory[end, figure]] * 2
            own.append(Series(f"persson, {name}", [0, spacing.max()], level, line=True))
        series += own
        colours |= {part.name: CYCLE[end] for part in own}
    return curves(
        series,
        x="root of 1 / points per shortest wavelength (–)",
        y=y,
        columns=("root_of_spacing", column),
        caption=caption,
        colours=colours,
        hollow=[f"{name}, limit" for name in ENDS],
        level=0.0,
    )


def _draw_windows(found: Ends, told: str) -> Chart:
    series, colours = list[Series](), dict[str, str]()
    for colour, end in zip(CYCLE, range(2), strict=False):
        bands = [found.limit(end, 2 + k) for k in range(len(WINDOWS))]
        mean, width = (np.array([getattr(b, key)[-1] for b in bands]) for key in _BAND)
        own = [
            Series(f"{ENDS[end]}, corrected", WINDOWS, mean, mean - width, mean + width),
            Series(
                f"persson, {ENDS[end]}",
                [0.0, *WINDOWS],
                [found.end_slopes[end], *found.theory[end, 2:]],
                line=True,
            ),
        ]
        series += own
        colours |= {one.name: colour for one in own}
    ratios = "; ".join(
        f"{ENDS[end]}: "
        + ", ".join(
            f"{found.values[:, -1, end, 2 + k].mean() / found.theory[end, 2 + k]:.2f} at {w:g}"
            for k, w in enumerate(WINDOWS)
        )
        for end in range(2)
    )
    return curves(
        series,
        x=r"window over hardness (–)",
        y=r"mean slope within it, $P'\,\sigma_\mathrm{P}^2$ (–)",
        columns=("relative_window", "relative_slope"),
        caption="Mean slope of the density of the pressure within a window of either end, 2 F/w² "
        f"of the corrected area F within a window w, at {found.points[-1]:g} points per shortest "
        f"wavelength, {told}, with 95 % intervals, beside the theory's. Boundary elements over "
        f"theory, by window: {ratios}; of the whole elastic area: {found.elastic:.2f}.",
        colours=colours,
        limits={"ylim": (0, None)},
    )


_BAND = ("mean", "half_width")


def _vanishing(found: Ends) -> str:
    sentences = []
    for end, name in enumerate(ENDS):
        one = found.limit(end, DENSITY)
        order = -observed_order(found.points, one.mean)
        verdict = "zero lies within" if abs(one.limit) <= one.error else "zero lies outside"
        sentences.append(
            f"At {name} it falls from {one.mean[0]:.3g} to {one.mean[-1]:.3g}, as the spacing to "
            f"the power {order:.2f}, with the limit {one.limit:+.2g} ± {one.error:.2g}: {verdict}."
        )
    return " ".join(sentences)


def _slopes_told(found: Ends, figure: int) -> str:
    sentences = []
    for end, name in enumerate(ENDS):
        one, theory = found.limit(end, figure), found.theory[end, figure]
        sentences.append(
            f"At {name}: {one.mean[-1]:.3g} on the finest grid, limit {one.limit:.3g} ± "
            f"{one.error:.2g}; theory {theory:.3g}, so that the limit is {one.limit / theory:.2f} "
            f"of it; at the very end the theory has {found.end_slopes[end]:.3g}."
        )
    return " ".join(sentences)
