"""The effective hardness of a J2 body: at which cap the capped body has its contact area.

The scenes are those of the cases fem-model-*: 4 of the shortest waves in a period, a bonded layer
as deep as the period, pressed with a twelfth of 3 sigma_Y.  By similarity E* xi/sigma_Y and
Poisson's ratio are all that is left.  Every figure is a mean over surfaces with its 95 %
interval, J2 and cap on the elements' own compliance (`model_difference`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.results import FloatArray
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes
from epcontact.surfaces import SelfAffine

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart


PERIOD = 1e-3  # m
WAVES = 4  # the shortest ones in a period
SLOPE = 0.05
YOUNG = 210e9  # Pa
TABOR = 3.0  # hardness/sigma_Y
NUS = (0.0, 0.3, 0.45)
SEVERITIES = (5.0, 15.0, 50.0)  # E* xi/sigma_Y
NAMES = ("effective_hardness", "effective_overlap", "model_overlap", "model_area")


def model_scene(severity: float, nu: float, seed: int, nodes: int, waves: int = WAVES) -> Scene:
    """A scene at E* xi/sigma_Y = `severity` on nodes x nodes points, with so many of the shortest
    waves in a period."""
    q = 2 * math.pi / PERIOD
    spectrum = SelfAffineSpectrum(0.8, q, q, waves * q, SLOPE)
    yield_stress = YOUNG / (1 - nu**2) * SLOPE / severity
    return Scene(
        SelfAffine(spectrum, (PERIOD,) * 2, (nodes,) * 2, seed).build(),
        Material(YOUNG, nu, TABOR * yield_stress, yield_stress),
        Load(TABOR * yield_stress / 12),
        Body("bonded_layer", PERIOD),
    )


def measured(
    severity: float,
    nu: float,
    seeds: Sequence[int],
    nodes: int,
    progress: Progress,
    waves: int = WAVES,
) -> FloatArray:
    """(surfaces, names): the measures `NAMES` of the J2 body on each surface."""
    import fem_check
    from epcontact.harness.quantities import measure_all

    rows = []
    for seed in seeds:
        progress(f"hardness: E* xi/sigma_Y = {severity:g}, nu = {nu:g}, {nodes} nodes, seed {seed}")
        scene = model_scene(severity, nu, seed, nodes, waves)
        result = fem_check.solve(scene, law="j2", certified=False)
        found = measure_all([f"quantity.{name}" for name in NAMES], scene, result)
        rows.append(list(found.values()))
    return np.array(rows)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Effective hardness, overlaps and area against E* xi/sigma_Y; effective hardness by grid and
    by breadth of the spectrum."""
    fast = size == "fast"
    seeds, nodes = (range(101, 104), 24) if fast else (range(101, 117), 48)
    tables = {
        nu: np.array([measured(s, nu, seeds, nodes, progress) for s in SEVERITIES]) for nu in NUS
    }
    grids = (16, 24, 32) if fast else (16, 24, 32, 48, 64, 96)
    few = seeds[:2] if fast else seeds[:4]
    by_grid = {
        s: np.array([measured(s, 0.3, few, n, progress)[:, 0] for n in grids]) for s in SEVERITIES
    }
    waves, points = ((2, 4), 6) if fast else ((2, 4, 8), 8)
    some = seeds[:2] if fast else seeds[:8]
    by_breadth = {
        s: np.array([measured(s, 0.3, some, points * w, progress, w)[:, 0] for w in waves])
        for s in SEVERITIES
    }
    told = f"{len(seeds)} surfaces of {nodes} x {nodes} nodes"
    return (
        *draw_severities(SEVERITIES, tables, told),
        draw_grids([n / WAVES for n in grids], by_grid, len(few)),
        draw_breadths(waves, by_breadth, points, len(some)),
    )


def draw_severities(
    severities: Sequence[float], tables: dict[float, FloatArray], told: str
) -> tuple[Chart, ...]:
    """tables: (severities, surfaces, names) by Poisson's ratio; told: of what they are means."""

    def series(name: str) -> list[Series]:
        column = NAMES.index(name)
        return [
            _with_interval(f"nu = {nu:g}", severities, table[..., column])
            for nu, table in tables.items()
        ]

    end = (
        f"Means over {told} with their 95 % intervals; elastic-plastic rough scenes pressed with "
        "a quarter of the yield stress, J2 and cap on the same elements' compliance."
    )
    x = "E* xi / sigma_Y (–)"
    overlap = "shared contact over the union of both (–)"
    return (
        curves(
            series("effective_hardness"),
            x=x,
            y="effective hardness c = hardness / sigma_Y (–)",
            columns=("severity", "effective_hardness"),
            caption="Effective hardness: the cap, in yield stresses, under which a capped body "
            f"has the contact area of the J2 body. Dotted: 3, Tabor's rule. {end}",
            log="x",
            ticks=severities,
            level=TABOR,
        ),
        curves(
            series("effective_overlap"),
            x=x,
            y=overlap,
            columns=("severity", "effective_overlap"),
            caption="Overlap of the contact of the J2 body with that of the capped one, with the "
            f"cap at the effective hardness: equal areas, not quite in the same places. {end}",
            log="x",
            ticks=severities,
        ),
        curves(
            series("model_overlap"),
            x=x,
            y=overlap,
            columns=("severity", "model_overlap"),
            caption="Overlap of the contact of the J2 body with that of the capped one, with the "
            f"cap at 3 sigma_Y. {end}",
            log="x",
            ticks=severities,
        ),
        curves(
            series("model_area"),
            x=x,
            y="area of J2 over that of the cap, less 1 (–)",
            columns=("severity", "excess_area"),
            caption="By how much the contact area of the J2 body exceeds that under a cap of "
            f"3 sigma_Y. {end}",
            log="x",
            ticks=severities,
        ),
    )


def draw_grids(points: Sequence[float], by_grid: dict[float, FloatArray], surfaces: int) -> Chart:
    """by_grid: (grids, surfaces) of effective hardnesses by severity; points: a shortest wave."""
    return curves(
        [
            _with_interval(f"E* xi / sigma_Y = {s:g}", points[:-1], table[:-1] - table[-1])
            for s, table in by_grid.items()
        ],
        x="nodes per shortest wavelength (–)",
        y="effective hardness less that on the finest grid (–)",
        columns=("nodes_per_wavelength", "change_of_effective_hardness"),
        caption="What the grid does to the effective hardness, with nu = 0.3: its difference from "
        f"that on {points[-1]:g} nodes per shortest wavelength, mean over the same {surfaces} "
        "surfaces with its 95 % interval.",
        log="x",
        ticks=points[:-1],
        level=0.0,
    )


def draw_breadths(
    waves: Sequence[int], by_breadth: dict[float, FloatArray], points: int, surfaces: int
) -> Chart:
    """by_breadth: (spectra, surfaces) of effective hardnesses by severity."""
    return curves(
        [_with_interval(f"E* xi / sigma_Y = {s:g}", waves, t) for s, t in by_breadth.items()],
        x="longest over shortest wavelength (–)",
        y="effective hardness c = hardness / sigma_Y (–)",
        columns=("wavelength_ratio", "effective_hardness"),
        caption="What the breadth of the spectrum does to the effective hardness, with nu = 0.3 "
        f"and {points} nodes per shortest wavelength: means over {surfaces} surfaces with their "
        "95 % intervals. The severity is of the whole spectrum's slope.",
        log="x",
        ticks=waves,
        level=TABOR,
    )


def _with_interval(name: str, x: Sequence[float], table: FloatArray) -> Series:
    """table: (x, surfaces)."""
    mean, half = np.array([scenes.mean_and_half_width(list(row)) for row in table]).T
    return Series(name, x, mean, mean - half, mean + half)
