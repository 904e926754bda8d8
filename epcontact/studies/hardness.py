"""The effective hardness of a J2 body: the cap at which a capped body has its contact area.

The scenes are those of the cases fem-model-*: 4 of the shortest waves in a period, a bonded layer
as deep as the period, pressed with a twelfth of 3 sigma_Y.  By similarity they depend only on
E* xi/sigma_Y and Poisson's ratio.  Every figure is a mean over surfaces with its 95 %
interval, J2 and cap on the elements' own compliance (`model_difference`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import pandas as pd

import fem_check
from epcontact.harness.quantities.registry import measure_all
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum
from epcontact.studies.tables import Progress, Size, mean_with_interval
from epcontact.surfaces import SelfAffine

PERIOD = 1e-3  # m
WAVES = 4  # number of shortest waves in a period
HURST = 0.8
SLOPE = 0.05
YOUNG = 210e9  # Pa
TABOR = 3.0  # hardness/sigma_Y
NUS = (0.0, 0.3, 0.45)
SEVERITIES = (5.0, 15.0, 50.0)  # E* xi/sigma_Y
#: The measures, each with the label of its axis and its meaning.
_OVERLAP = "shared contact over the union of both (–)"
MEASURES = {
    "effective_hardness": (
        "effective hardness c = hardness / sigma_Y (–)",
        "Effective hardness: the cap, in yield stresses, under which a capped body has the "
        "contact area of the J2 body. Dotted: 3, Tabor's rule",
    ),
    "effective_overlap": (
        _OVERLAP,
        "Overlap of the contact of the J2 body with that of the capped one, with the cap at the "
        "effective hardness: equal areas, not quite in the same places",
    ),
    "model_overlap": (
        _OVERLAP,
        "Overlap of the contact of the J2 body with that of the capped one, with the cap at 3 "
        "sigma_Y",
    ),
    "model_area": (
        "area of J2 over that of the cap, less 1 (–)",
        "Contact area of the J2 body over that under a cap of 3 sigma_Y, less 1",
    ),
}


def model_scene(
    severity: float, nu: float, seed: int, nodes: int, waves: int = WAVES, hurst: float = HURST
) -> Scene:
    """A scene at E* xi/sigma_Y = `severity` on nodes x nodes points; `waves` of the shortest
    waves in a period."""
    q = 2 * math.pi / PERIOD
    spectrum = SelfAffineSpectrum(hurst, q, q, waves * q, SLOPE)
    yield_stress = YOUNG / (1 - nu**2) * SLOPE / severity
    return Scene(
        SelfAffine(spectrum, (PERIOD,) * 2, (nodes,) * 2, seed).build(),
        Material(YOUNG, nu, TABOR * yield_stress, yield_stress),
        Load(TABOR * yield_stress / 12),
        Body("bonded_layer", PERIOD),
    )


def measured(
    seeds: Sequence[int],
    progress: Progress,
    *,
    nodes: int,
    nus: Sequence[float] = (0.3,),
    severities: Sequence[float] = SEVERITIES,
    waves: int = WAVES,
    steps: int | None = None,
) -> pd.DataFrame:
    """Compare J2 flow and cap on each surface, at each severity and Poisson's ratio.

    `steps` are the equal increments of the J2 path; None: chosen by their error.

    Returns:
        One row for each scene: nu, severity, seed, nodes_per_wavelength, wavelength_ratio and
        MEASURES.
    """
    rows = []
    for nu in nus:
        for severity in severities:
            for seed in seeds:
                progress(
                    f"hardness: E*ξ/σ_Y = {severity:g}, nu = {nu:g}, {nodes} nodes, seed {seed}"
                )
                scene = model_scene(severity, nu, seed, nodes, waves)
                result = fem_check.solve(scene, law="j2", steps=steps, certified=False)
                key = {"nu": nu, "severity": severity, "seed": seed}
                key |= {"nodes_per_wavelength": nodes / waves, "wavelength_ratio": waves}
                measures = measure_all([f"quantity.{name}" for name in MEASURES], scene, result)
                rows.append(key | dict(zip(MEASURES, measures.values(), strict=True)))
    return pd.DataFrame(rows)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Effective hardness, overlaps and area against E* xi/sigma_Y; effective hardness by grid and
    by breadth of the spectrum."""
    fast = size == "fast"
    seeds, nodes = (range(101, 104), 24) if fast else (range(101, 117), 48)
    # Four increments are too few where yield_stress is small, but quick.
    solve = functools.partial(measured, progress=progress, steps=4 if fast else None)
    ratios = solve(seeds, nodes=nodes, nus=NUS)
    few, grids = (seeds[:2], (16, 24, 32)) if fast else (seeds[:4], (16, 24, 32, 48, 64, 96))
    by_grid = pd.concat([solve(few, nodes=n) for n in grids])
    some, points, spectra = (seeds[:2], 6, (2, 4)) if fast else (seeds[:8], 8, (2, 4, 8))
    by_breadth = pd.concat([solve(some, nodes=points * w, waves=w) for w in spectra])
    return (
        *draw_severities(
            ratios,
            f"{len(seeds)} surfaces of {nodes} x {nodes} nodes, "
            f"{'four load steps' if fast else 'load steps chosen by their error'},",
        ),
        draw_grids(by_grid),
        draw_breadths(by_breadth),
    )


def draw_severities(table: pd.DataFrame, surfaces: str) -> tuple[Chart, ...]:
    """Draw each of MEASURES against the severity; `surfaces` describes the averaged surfaces."""
    table = table.assign(series=table["nu"].map("nu = {:g}".format))
    drawn = []
    for name, (label, meaning) in MEASURES.items():
        plot = Plot(
            ("severity", "E* xi / sigma_Y (–)"),
            (name, label),
            log="x",
            ticks=sorted(table["severity"].unique()),
            level=TABOR if name == "effective_hardness" else None,
        )
        caption = (
            f"{meaning}. Means over {surfaces} with their 95 % intervals; elastic-plastic rough "
            "scenes pressed with a quarter of the yield stress, J2 and cap on the same elements' "
            "compliance."
        )
        means = mean_with_interval(table, name, ["series", "severity"])
        drawn.append(draw_table(means, plot, caption))
    return tuple(drawn)


def draw_grids(table: pd.DataFrame) -> Chart:
    """Draw the effective hardness minus that on the finest grid of the table."""
    finest = table["nodes_per_wavelength"].max()
    key = ["severity", "seed"]
    reference = table[table["nodes_per_wavelength"] == finest][[*key, "effective_hardness"]]
    both = table[table["nodes_per_wavelength"] < finest].merge(
        reference, on=key, suffixes=("", "_finest")
    )
    change = both["effective_hardness"] - both["effective_hardness_finest"]
    both = both.assign(change_of_effective_hardness=change)
    return _draw_by_severity(
        both,
        ("nodes_per_wavelength", "nodes per shortest wavelength (–)"),
        ("change_of_effective_hardness", "effective hardness less that on the finest grid (–)"),
        0.0,
        "Effect of the grid on the effective hardness: its difference from that on "
        f"{finest:g} nodes per shortest wavelength",
    )


def draw_breadths(table: pd.DataFrame) -> Chart:
    """Draw the effective hardness against the ratio of longest to shortest wavelength."""
    return _draw_by_severity(
        table,
        ("wavelength_ratio", "longest over shortest wavelength (–)"),
        ("effective_hardness", MEASURES["effective_hardness"][0]),
        TABOR,
        "Effect of the breadth of the spectrum on the effective hardness; the severity is of the "
        "whole spectrum's slope",
    )


def _draw_by_severity(
    table: pd.DataFrame, x: tuple[str, str], y: tuple[str, str], level: float, meaning: str
) -> Chart:
    table = table.assign(series=table["severity"].map("E* xi / sigma_Y = {:g}".format))
    return draw_table(
        mean_with_interval(table, y[0], ["series", x[0]]),
        Plot(x, y, log="x", ticks=sorted(table[x[0]].unique()), level=level),
        f"{meaning}. nu = {table['nu'].iloc[0]:g}, mean over {table['seed'].nunique()} surfaces "
        "with its 95 % interval.",
    )
