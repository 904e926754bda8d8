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
of the spacing, the mean slope as the spacing.  Beside them is the density of the theory, its
slopes taken within the same windows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.curves import pressure_density
from epcontact.results import FloatArray, PressureDistribution
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.results import ContactResult
    from epcontact.scene import Scene


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
    elastic: corrected elastic area on the finest grid, mean of the surfaces, over the theory's.
    densities: (pressure, P) of the theory and of each grid, mean over BINS, by name.
    """

    points: FloatArray
    values: FloatArray
    theory: FloatArray
    end_slopes: FloatArray
    elastic: float
    densities: dict[str, tuple[FloatArray, FloatArray]]
    bandwidth: int

    def limit(self, end: int, figure: int) -> Limit:
        """Of one figure at one end; slopes without the coarsest grid, whose rims fill WINDOW."""
        from epcontact.bem.areas.distribution import extrapolated

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

    rows, elastic, found = [], list[float](), dict[int, list[FloatArray]]()
    for seed in seeds:
        progress(f"pressures: seed {seed}")
        for n in points:
            result = bem.solve(scenes.rough_scene(n, seed, bandwidth), area_tolerance=1e-6)
            rows.append(figures_of(result, n))
            found.setdefault(n, []).append(_binned(result.distribution)[1])
        elastic.append(scenes.area_of(result, "elastic"))
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
        float(np.mean(elastic) / distribution.cumulative[-1]),
        densities,
        bandwidth,
    )


def figures_of(result: ContactResult, points: float) -> FloatArray:
    """(2 ends, 2 + windows) of a solution; see `Ends.values`."""
    from epcontact.bem.areas.distribution import end_fits

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
    from epcontact.bem.areas.distribution import end_fit

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
    from epcontact.studies.pressures_charts import draw_ends

    bandwidth = 32 if size == "fast" else 128
    return draw_ends(measure((4, 8, 16, 32), bandwidth, range(7, 15), progress))
