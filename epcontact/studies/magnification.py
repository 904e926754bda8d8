"""Theory against boundary elements at every magnification of one roughness.

A surface filtered at the wave number zeta q_0 is what the theory sees at the magnification zeta.
Each filtered surface is solved, and its areas in the continuum limit are laid over the theory's
curves, read from the very modes of the surface (all surfaces of random phases have the same
ones); at five cut-offs the distributions of the pressure too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.curves import pressure_density
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.output.charts.style import CYCLE, STATE_COLOURS, unit_for
from epcontact.results import ELASTIC, PLASTIC, ContactResult, FloatArray, PressureDistribution
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.persson import MagnificationCurve
    from epcontact.scene import Scene


_COLOURS = {"total": CYCLE[0], "elastic": STATE_COLOURS[ELASTIC], "plastic": STATE_COLOURS[PLASTIC]}
BINS = 40


@dataclass(frozen=True)
class Comparison:
    """Areas by part (total, elastic, plastic) at the magnifications (n,), and distributions.

    bem, half_width: mean over the surfaces and half its 95 % interval, estimated errors included.
    theory: at the same magnifications; curve: at many.  densities: by magnification,
    (pressure in Pa, bem in 1/Pa, theory in 1/Pa), (m,) each.
    """

    magnification: FloatArray
    bem: dict[str, FloatArray]
    half_width: dict[str, FloatArray]
    theory: dict[str, FloatArray]
    curve: MagnificationCurve
    densities: dict[float, tuple[FloatArray, FloatArray, FloatArray]]
    surfaces: int


def measure(
    points_per_wavelength: float,
    bandwidth: int,
    magnifications: Sequence[float],
    seeds: Sequence[int],
    progress: Progress,
) -> Comparison:
    """Solve every surface at every cut-off; five of them, evenly chosen, give distributions.

    Raises InvalidScene for a magnification beyond the band, NotConverged.
    """
    from epcontact import persson

    zeta = np.asarray(magnifications, dtype=np.float64)
    scene = scenes.rough_scene(points_per_wavelength, seeds[0], bandwidth)
    body = persson.Theory.of_scene(scene, energy_reduction=scenes.GAMMA, spectrum="surface")
    curve = body.magnification_curve(scene.load.final, np.geomspace(1, bandwidth, 1000))
    at = body.magnification_curve(scene.load.final, zeta)
    solved = [_solve(points_per_wavelength, seed, bandwidth, zeta, progress) for seed in seeds]
    bem, half_width = {}, {}
    for part in scenes.PARTS:
        bands = [scenes.area_band([row[i] for row in solved], part) for i in range(zeta.size)]
        bem[part], half_width[part] = np.array(bands).T
    densities = {
        float(zeta[i]): _densities(scene, [row[i] for row in solved], float(zeta[i]))
        for i in five_of(zeta.size)
    }
    theory = {part: getattr(at, part) for part in scenes.PARTS}
    return Comparison(zeta, bem, half_width, theory, curve, densities, len(solved))


def five_of(count: int) -> list[int]:
    """Five of `count` indices, evenly chosen, the last one always; all, if there are no more."""
    if count <= 5:
        return list(range(count))
    return sorted(set(np.linspace(0, count - 1, 6).round().astype(int).tolist()[1:]))


def _solve(
    points: float, seed: int, bandwidth: int, zeta: FloatArray, progress: Progress
) -> list[ContactResult]:
    from epcontact import bem
    from epcontact.surfaces import filtered

    whole = scenes.rough_scene(points, seed, bandwidth)
    results = []
    for one in zeta.tolist():
        progress(f"magnification: seed {seed}, zeta = {one:.3g}")
        scene = scenes.on_surface(whole, filtered(whole.surface, one * scenes.LOWEST))
        results.append(replace(bem.solve(scene, area_tolerance=1e-5), fields={}))
    return results


def _densities(
    scene: Scene, results: Sequence[ContactResult], zeta: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pressures and P(sigma) of boundary elements and theory, each the mean over its bin."""
    from epcontact import persson

    tables = [r.distribution for r in results if r.distribution is not None]
    found = [pressure_density(table, BINS, scenes.HARDNESS) for table in tables]
    body = persson.Theory.of_scene(scene, energy_reduction=scenes.GAMMA, spectrum="surface")
    curve = body.pressure_curve(scene.load.final, zeta)
    table = PressureDistribution(curve.pressure, curve.cumulative, curve.plastic)
    pressure, theory = pressure_density(table, BINS, scenes.HARDNESS)
    return pressure, np.mean([density for _, density in found], axis=0), theory


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Areas against magnification, their deviation, and P(sigma) at five magnifications."""
    points, bandwidth, count = (4, 64, 13) if size == "fast" else (8, 256, 10)
    zeta = np.geomspace(1.5, bandwidth, count).round(1)
    return draw_comparison(measure(points, bandwidth, zeta.tolist(), range(7, 11), progress))


def draw_comparison(found: Comparison) -> tuple[Chart, Chart, Chart]:
    """The three charts of a comparison."""
    told = (
        f"of the paper's roughness, material and load (p0/(E* xi) = 0.05 and hardness/(E* xi) = "
        f"0.6 at the last magnification, gamma = {scenes.GAMMA}). Boundary elements: each surface "
        f"filtered at the wave number zeta q_0, in the continuum limit, mean of {found.surfaces} "
        "surfaces with its 95 % interval. Theory: with the spectrum of the very same modes."
    )
    zeta, curve = found.magnification, found.curve
    x = r"magnification $\zeta = q / q_0$ (–)"
    lines = [
        Series(f"{part}, theory", curve.magnification, getattr(curve, part), line=True)
        for part in scenes.PARTS
    ]
    points = [
        Series(f"{p}, bem", zeta, v, np.maximum(v - w, 1e-12), v + w)
        for p, v, w in ((p, found.bem[p], found.half_width[p]) for p in scenes.PARTS)
    ]
    deviations = []
    for part in scenes.PARTS:
        shown = found.theory[part] > 0.01  # below, a ratio would be one of rare points
        theory = found.theory[part][shown]
        d = 100 * (found.bem[part][shown] / theory - 1)
        width = 100 * found.half_width[part][shown] / theory
        deviations.append(Series(part, zeta[shown], d, d - width, d + width))
    return (
        curves(
            [*lines, *points],
            x=x,
            y=r"contact area $A / A_0$ (–)",
            columns=("magnification", "area_fraction"),
            caption=f"Contact areas against magnification {told}",
            log="xy",
            colours={f"{p}, {who}": c for p, c in _COLOURS.items() for who in ("theory", "bem")},
            limits={"ylim": (1e-3, 1.3)},
            apart=[one.name for one in points],
        ),
        curves(
            deviations,
            x=x,
            y="boundary elements over theory, less 1 (%)",
            columns=("magnification", "deviation_percent"),
            caption=f"Deviation of the boundary elements from the theory, where the theory's area "
            f"exceeds 0.01, {told} {_worst(found)}",
            log="x",
            colours=_COLOURS,
            level=0.0,
        ),
        _draw_densities(found, told),
    )


def _worst(found: Comparison) -> str:
    last = ", ".join(
        f"{p} {100 * (found.bem[p][-1] / found.theory[p][-1] - 1):+.1f} %" for p in scenes.PARTS
    )
    d = found.bem["total"] / found.theory["total"] - 1
    i = int(np.argmax(np.abs(d)))
    return (
        f"At the last magnification: {last}. Total area, largest deviation: {100 * d[i]:+.1f} % "
        f"at zeta = {found.magnification[i]:.3g}."
    )


def _draw_densities(found: Comparison, told: str) -> Chart:
    scale, unit = unit_for(scenes.HARDNESS, "Pa")
    series, colours = [], {}
    for colour, (zeta, (pressure, bem, theory)) in zip(
        CYCLE, found.densities.items(), strict=False
    ):
        for name, density, line in (("theory", theory, True), ("bem", bem, False)):
            label = f"zeta = {zeta:.3g}, {name}"
            colours[label] = colour
            series.append(Series(label, pressure / scale, density * scale, line=line))
    return curves(
        series,
        x=rf"contact pressure $\sigma$ ({unit})",
        y=rf"density $P(\sigma, \zeta)$ (1/{unit})",
        columns=(f"pressure_{unit}", f"density_per_{unit}"),
        caption="Density of the pressure in elastic contact at several magnifications, mean over "
        f"{BINS} bins of the raw grid values, which know no continuum limit, {told}",
        log="y",
        colours=colours,
        limits={"ylim": (1e-5, None), "xlim": (0, scenes.HARDNESS / scale)},
        apart=[one.name for one in series if not one.line],
    )
