"""Theory against boundary elements at every magnification of one roughness.

A surface filtered at the wave number zeta q_0 is what the theory sees at the magnification zeta.
Each filtered surface is solved, and its areas in the continuum limit are drawn over the theory's
curves for the modes of the same surface (surfaces of random phases share their amplitudes).  At
five cut-offs the pressure distributions are compared, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.output.charts.curves import pressure_density
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import CYCLE, STATE_COLOURS
from epcontact.results import ELASTIC, PLASTIC, PressureDistribution
from epcontact.scene import Scene
from epcontact.studies.paper_scene import GAMMA, HARDNESS, LOWEST, PARTS, area_rows, rough_scene
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval
from epcontact.surfaces import filtered

BINS = 40
_COLOURS = {"total": CYCLE[0], "elastic": STATE_COLOURS[ELASTIC], "plastic": STATE_COLOURS[PLASTIC]}
#: Smallest area, over the nominal one, for a ratio: smaller areas are a few grid points.
_SMALLEST_AREA = 0.01


def boundary_element_tables(
    points_per_wavelength: float,
    bandwidth: int,
    magnifications: Sequence[float],
    seeds: Sequence[int],
    progress: Progress,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Solve every surface at every cut-off.

    Args:
        points_per_wavelength: grid points per shortest wavelength of the whole surface.
        bandwidth: highest over lowest wave number.
        magnifications: of the cut-offs, rising.
        seeds: one surface each.
        progress: called with a sentence before each solve.

    Returns:
        Areas, one row for each part and magnification: part, magnification and area_fraction with
        its interval.  Densities of the pressure at five of the magnifications, one row for each
        bin: magnification, pressure_GPa and density_per_GPa, means over the surfaces.

    Raises:
        InvalidScene: a magnification is beyond the band.
        NotConverged: a solve failed.
    """
    areas, densities = [], []
    distributed = {magnifications[i] for i in five_of(len(magnifications))}
    for seed in seeds:
        whole = rough_scene(points_per_wavelength, seed, bandwidth)
        for zeta in magnifications:
            progress(f"magnification: seed {seed}, zeta = {zeta:.3g}")
            scene = replace(whole, surface=filtered(whole.surface, zeta * LOWEST))
            result = bem.solve(scene, area_tolerance=1e-5)
            areas += area_rows(result, magnification=zeta)
            if zeta in distributed:
                densities.append(_binned(result.distribution, zeta))
    means = mean_with_interval(
        pd.DataFrame(areas), "area_fraction", ["part", "magnification"], "estimated_error"
    )
    bins = pd.concat(densities).groupby(["magnification", "pressure_GPa"], sort=False)
    return means, bins["density_per_GPa"].mean().reset_index()


def theory_tables(
    scene: Scene, magnifications: Sequence[float], distributed: Sequence[float]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the theory's areas at the magnifications, and its densities at `distributed`, with
    the columns of `boundary_element_tables` (without intervals)."""
    theory = persson.Theory.of_scene(scene, energy_reduction=GAMMA, spectrum="surface")
    curve = theory.magnification_curve(scene.load.final, magnifications)
    areas = pd.DataFrame({part: getattr(curve, part) for part in PARTS})
    areas["magnification"] = curve.magnification
    densities = []
    for zeta in distributed:
        at = theory.pressure_curve(scene.load.final, zeta)
        table = PressureDistribution(at.pressure, at.cumulative, at.plastic)
        densities.append(_binned(table, zeta))
    return areas.melt("magnification", list(PARTS), "part", "area_fraction"), pd.concat(densities)


def five_of(count: int) -> list[int]:
    """Return five of `count` indices, evenly spaced up to the last; all if there are fewer.

    Example:
        >>> five_of(13)
        [2, 5, 7, 10, 12]
    """
    if count <= 5:
        return list(range(count))
    return sorted(set(np.linspace(0, count - 1, 6).round().astype(int).tolist()[1:]))


def _binned(distribution: PressureDistribution | None, zeta: float) -> pd.DataFrame:
    assert distribution is not None
    pressure, density = pressure_density(distribution, BINS, HARDNESS)
    columns = {"pressure_GPa": pressure / 1e9, "density_per_GPa": density * 1e9}
    return pd.DataFrame({"magnification": zeta} | columns)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart areas against magnification, their deviation, and P(sigma) at five of them."""
    points, bandwidth, count = (4, 64, 13) if size == "fast" else (8, 256, 10)
    zeta, seeds = np.geomspace(1.5, bandwidth, count).round(1).tolist(), range(7, 11)
    areas, densities = boundary_element_tables(points, bandwidth, zeta, seeds, progress)
    scene = rough_scene(points, seeds[0], bandwidth)
    return draw_magnification(scene, areas, densities, len(seeds))


def draw_magnification(
    scene: Scene, areas: pd.DataFrame, densities: pd.DataFrame, surfaces: int
) -> tuple[Chart, Chart, Chart]:
    """Draw the three charts of areas and densities by boundary elements and by the theory."""
    zeta = areas["magnification"].unique().tolist()
    distributed = densities["magnification"].unique().tolist()
    every = np.geomspace(1, zeta[-1], 1000).tolist()
    curves, _ = theory_tables(scene, every, distributed)
    theory, theory_densities = theory_tables(scene, zeta, distributed)
    measured = areas.assign(area_fraction_low=areas["area_fraction_low"].clip(lower=1e-12))
    both = pd.concat(
        [
            curves.assign(method="theory", style="curve"),
            measured.assign(method="bem", style="marks"),
        ]
    )
    deviations = areas.merge(theory, on=["part", "magnification"], suffixes=("", "_theory"))
    deviations = deviations[deviations["area_fraction_theory"] > _SMALLEST_AREA]
    for end in ("", "_low", "_high"):
        ratio = deviations[f"area_fraction{end}"] / deviations["area_fraction_theory"]
        deviations[f"deviation_percent{end}"] = 100 * (ratio - 1)
    last = deviations[deviations["magnification"] == zeta[-1]]
    of_scene = (
        f"of the paper's roughness, material and load (p0/(E* xi) = 0.05 and hardness/(E* xi) = "
        f"0.6 at the last magnification, gamma = {GAMMA}). Boundary elements: each surface "
        f"filtered at the wave number zeta q_0, in the continuum limit, mean of {surfaces} "
        "surfaces with its 95 % interval. Theory: with the spectrum of the very same modes."
    )
    plot = Plot(
        ("magnification", r"magnification $\zeta = q / q_0$ (–)"),
        ("area_fraction", r"contact area $A / A_0$ (–)"),
        series=("part", "method"),
        colour="part",
        colours=_COLOURS,
        log="xy",
        limits={"ylim": (1e-3, 1.3)},
    )
    deviation = replace(
        plot,
        y=("deviation_percent", "boundary elements over theory, less 1 (%)"),
        series=("part",),
        log="x",
        limits={},
        level=0.0,
    )
    return (
        draw_table(both, plot, f"Contact areas against magnification {of_scene}"),
        draw_table(
            deviations,
            deviation,
            f"Deviation of the boundary elements from the theory, where the theory's area exceeds "
            f"{_SMALLEST_AREA}, {of_scene} At the last magnification: "
            f"{listed(last, '{part} {deviation_percent:+.1f} %')}.",
        ),
        _draw_densities(densities, theory_densities, of_scene),
    )


def _draw_densities(measured: pd.DataFrame, theory: pd.DataFrame, of_scene: str) -> Chart:
    table = pd.concat(
        [
            theory.assign(method="theory", style="curve"),
            measured.assign(method="bem", style="marks"),
        ]
    )
    table = table.sort_values("magnification", kind="stable")
    table["zeta"] = table["magnification"].map("zeta = {:.3g}".format)
    plot = Plot(
        ("pressure_GPa", r"contact pressure $\sigma$ (GPa)"),
        ("density_per_GPa", r"density $P(\sigma, \zeta)$ (1/GPa)"),
        series=("zeta", "method"),
        colour="zeta",
        log="y",
        limits={"ylim": (1e-5, None), "xlim": (0, HARDNESS / 1e9)},
    )
    return draw_table(
        table,
        plot,
        "Density of the pressure in elastic contact at several magnifications, mean over "
        f"{BINS} bins of the raw grid values, which have no continuum limit, {of_scene}",
    )
