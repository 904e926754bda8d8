"""P(sigma) at both its ends: does it vanish at 0+ and at hardness-, and how steep is it there?

The paper's scene with a narrow band of roughness on finer and finer grids.  The points next to
the rims fill the ends of a grid's P(sigma), so that no raw density is zero there.  Measured at
each end, in units of the hardness, as functions of the distance from the end:

    density     of the line with the area and the mean pressure of the points within a window of
                the end, at the end.  The window is WINDOW at COARSEST points per shortest
                wavelength and shrinks as the pressure next to a rim does, as the root of the
                spacing: a fixed one would leave what P bends within it
    raw slope   of that line, within WINDOW on every grid
    mean slope  2 F(w)/w^2 of the corrected area F(w) within a window w: the slope at the end if P
                is straight there and vanishes at it

Each is extrapolated, surface by surface, to ever finer grids: density and raw slope as the root
of the spacing, the mean slope as the spacing.  Beside them stands equation (3) of the theory, its
slopes taken within the same windows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from epcontact.output.charts import observed_order, pressure_density
from epcontact.output.figures import Series
from epcontact.output.style import CYCLE
from epcontact.results import PressureDistribution
from epcontact.studies import Progress, Size, scenes
from epcontact.studies.drawing import curves

if TYPE_CHECKING:
    from epcontact.output.figures import Chart
    from epcontact.results import ContactResult
    from epcontact.scene import Scene

FloatArray = NDArray[np.float64]

ENDS = ("0+", "hardness-")
#: Of the hardness.
WINDOW, COARSEST = 0.2, 4
WINDOWS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4)
#: The figures of an end; then the mean slopes within WINDOWS.
DENSITY, RAW_SLOPE, MEAN_SLOPE = 0, 1, 2 + WINDOWS.index(WINDOW)
BINS = 40


@dataclass(frozen=True)
class Limit:
    """A figure on grids of rising points per wavelength, (n,): its mean over the surfaces and
    half the 95 % interval; its limit and the error of that, of scatter and of fit together."""

    mean: FloatArray
    half_width: FloatArray
    limit: float
    error: float


@dataclass(frozen=True)
class Ends:
    """What was measured, in units of the hardness.

    points: (n,) per shortest wavelength.  values: (surfaces, n, 2 ends, 2 + windows), the last
    axis being density, raw slope and the mean slope within each window.  theory: (2, 2 + windows)
    alike, end_slopes: (2,) its slopes at the very ends.
    densities: (pressure, P) of the theory and of each grid, mean over BINS, by name.
    """

    points: FloatArray
    values: FloatArray
    theory: FloatArray
    end_slopes: FloatArray
    densities: dict[str, tuple[FloatArray, FloatArray]]
    bandwidth: int

    def limit(self, end: int, figure: int) -> Limit:
        """Of one figure at one end; slopes without the coarsest grid, whose rims fill WINDOW."""
        from epcontact.bem.distribution import extrapolated

        table = self.values[:, :, end, figure]
        order, first = (0.5, 0) if figure == DENSITY else (0.5 if figure == RAW_SLOPE else 1.0, 1)
        n, means = self.points[first:], table.mean(axis=0)[first:]
        bands = np.array([scenes.mean_and_half_width(column) for column in table.T])
        limits = [extrapolated(n, row[first:], order)[0] for row in table]
        limit, scatter = scenes.mean_and_half_width(limits)
        # Surfaces share what the fit leaves out: its error does not fall with their number.
        error = math.hypot(scatter, extrapolated(n, means, order)[1])
        return Limit(bands[:, 0], bands[:, 1], limit, error)


def measure(
    points: Sequence[int], bandwidth: int, seeds: Sequence[int], progress: Progress
) -> Ends:
    """Solve surfaces on grids of so many points per shortest wavelength, from coarse to fine."""
    from epcontact import bem

    rows, found = [], dict[int, list[FloatArray]]()
    for seed in seeds:
        progress(f"pressures: seed {seed}")
        for n in points:
            result = bem.solve(scenes.rough_scene(n, seed, bandwidth), area_tolerance=1e-6)
            rows.append(figures_of(result, n))
            found.setdefault(n, []).append(_binned(result.distribution)[1])
    scene = scenes.rough_scene(points[0], seeds[0], bandwidth)
    theory, end_slopes, distribution = theory_of(scene)
    pressure, density = _binned(distribution)
    densities = {"persson": (pressure, density)}
    densities |= {f"{n} points": (pressure, np.mean(d, axis=0)) for n, d in found.items()}
    return Ends(
        np.asarray(points, dtype=np.float64),
        np.reshape(rows, (len(seeds), len(points), 2, 2 + len(WINDOWS))),
        theory,
        end_slopes,
        densities,
        bandwidth,
    )


def figures_of(result: ContactResult, points: float) -> FloatArray:
    """(2 ends, 2 + windows) of a solution; see `Ends.values`."""
    from epcontact.bem.distribution import end_fits

    relative = result.fields["pressure"] / scenes.HARDNESS
    areas = result.final.areas["raw"], result.final.areas["corrected"]
    shrinking = WINDOW * math.sqrt(COARSEST / points)
    fits = [end_fits(relative, 1.0, w, areas) for w in (shrinking, *WINDOWS)]
    figures = []
    for end in range(2):
        at = [fit for pair in fits if (fit := pair[end]) is not None]
        slopes = [fit.continuum_slope for fit in at[1:]]
        figures.append([at[0].density, at[MEAN_SLOPE - 1].slope, *slopes])
    return np.array(figures)


def theory_of(scene: Scene) -> tuple[FloatArray, FloatArray, PressureDistribution]:
    """The theory's figures (2, 2 + windows) and slopes at the very ends (2,), in units of the
    hardness, and its distribution, for the spectrum of the scene's own surface."""
    from epcontact import persson
    from epcontact.bem.distribution import end_fit

    solved = persson.solve(scene, energy_reduction=scenes.GAMMA, spectrum="surface")
    told, hardness = solved.final.quantities, scenes.HARDNESS
    G, p0 = told["diffusion"] / hardness**2, scene.load.final / hardness
    elastic = solved.final.areas["raw"].elastic
    figures = []
    for end in range(2):
        fits = []
        for w in WINDOWS:
            d = np.linspace(0, w, 2001)
            within = persson.pressure_cumulative(1 - d if end else d, G, p0, 1.0)
            share = elastic - within if end else within
            # int d P dd = w F(w) - int F dd; the trapezoidal rule is right to 1e-7 of it.
            fits.append(end_fit(share[-1], w * share[-1] - np.trapezoid(share, d), w))
        slopes = [one.continuum_slope for one in fits]
        figures.append([0.0, fits[MEAN_SLOPE - 2].slope, *slopes])
    names = ("density_slope_at_zero", "density_slope_at_hardness")
    ends = np.abs([hardness**2 * told[name] for name in names])
    assert solved.distribution is not None
    return np.array(figures), ends, solved.distribution


def _binned(distribution: PressureDistribution | None) -> tuple[FloatArray, FloatArray]:
    assert distribution is not None
    pressure, density = pressure_density(distribution, BINS, scenes.HARDNESS)
    return pressure / scenes.HARDNESS, density * scenes.HARDNESS


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """P(sigma), its ends and its slopes there against the grid, its slopes against the window."""
    points, bandwidth = ((4, 8, 16, 32), 32) if size == "fast" else ((4, 8, 16, 32, 64), 64)
    return draw_ends(measure(points, bandwidth, range(7, 15), progress))


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
        f"wavelength, mean of {BINS} bins and of the surfaces, beside equation (3) of the theory "
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
        f"theory, by window: {ratios}.",
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
