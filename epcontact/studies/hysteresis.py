"""Contact area and mean gap on the way up and down: by a pressure cap, by J2 flow, and by theory.

Cap and J2 body follow the path; the theory comes down as the elastic contact of the surface that
it has flattened at the peak (`persson.separation`).  Part of the load's work stays in the body:

    cap   hardness times the mean plastic displacement      J2   sigma_Y times the plastic strain

What a load on the way down costs. Every load is solved from coarse grids and takes as many pairs
of transforms as the peak: 18 to 20 on 512 x 512 points, so that five loads down cost five times
the peak. Twice the peak would be 7.5 pairs for each of them. No better start can give that. Of
the 19 pairs the coarse grids take 3.5. On the finest grid five steps settle the sets of points
and bring the residual to 1e-4; in the four steps that follow no point changes its set, and each
of them lowers the residual to about a tenth by 1.8 pairs, one exact pair and three or four inner
iterations of a quarter. So a start that is right to 2e-5, with all sets as they should be, still
costs 8 pairs (`start_costs(4, 128, 3, print)`), while the best start that costs nothing, the last
pressures scaled by the load, is right to 0.2: where the load falls by a fifth, a tenth of the
contact is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

import fem_check
from epcontact import bem
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.persson.elastoplastic import areas
from epcontact.persson.separation import flattened_roughness, mean_separation
from epcontact.persson.theory import Theory
from epcontact.results import ContactResult
from epcontact.scene import Load, Scene
from epcontact.studies.gap import CONSTRAINT
from epcontact.studies.paper_scene import GAMMA, MODULUS, rough_scene
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval

#: Hardness over E* xi.
HARDNESS = 0.3
#: Loads over the peak, on the way up and in reverse on the way down.
SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
AREA, GAP, SPENT = "area", "mean_gap_over_rms_height", "plastic_share"
PAIRS = "equivalent_fft_pairs"


def cycle(scene: Scene) -> Scene:
    """The scene on the path up SHARES of its load and down again."""
    path = (*SHARES, *SHARES[-2::-1])
    return replace(scene, load=Load(tuple(scene.load.final * share for share in path)))


def cycle_table(
    points: int, bandwidth: int, seeds: Sequence[int], models: Sequence[str], progress: Progress
) -> pd.DataFrame:
    """Follow the cycle on every surface.

    Returns:
        One row for each model, branch, load and seed: model, branch ("up", "down"), load_over_peak,
        seed, AREA, GAP and SPENT, the share of the energy put in that flow has spent (NaN for the
        theory).
    """
    tables = []
    for seed in seeds:
        scene = rough_scene(points, seed, bandwidth, HARDNESS * MODULUS)
        height = scene.surface.rms_height
        for model in models:
            progress(f"hysteresis: {model}, seed {seed}")
            if model == "theory":
                area, gap = _theory(scene)
                spent = np.full(len(area), np.nan)
            else:
                result = _solved(model, cycle(scene))
                area = np.array([step.areas["corrected"].total for step in result.steps])
                gap = np.array([step.quantities["mean_gap"] for step in result.steps])
                spent = _spent(result)
            branch = ["up"] * len(SHARES) + ["down"] * (len(SHARES) - 1)
            columns = {"branch": branch, "load_over_peak": (*SHARES, *SHARES[-2::-1])}
            figures = {AREA: area, GAP: np.asarray(gap) / height, SPENT: spent}
            tables.append(pd.DataFrame({"model": model, "seed": seed} | columns | figures))
    return pd.concat(tables, ignore_index=True)


def start_costs(
    points: int, bandwidth: int, seed: int, progress: Progress, shares: Sequence[float] = (0.8, 0.4)
) -> pd.DataFrame:
    """Solve loads on the way down from starts that are ever nearer to the answer.

    Returns:
        One row for each load and start: load_over_peak, start_residual, pairs of transforms on all
        grids, and peak_pairs, those of the solve at the peak.  The first start of each load is
        from coarse grids, the second the peak's pressure, scaled; the others have been solved to
        a tolerance.
    """
    scene = rough_scene(points, seed, bandwidth, HARDNESS * MODULUS)
    peak, rows = bem.solve(scene), []
    flow = peak.fields["plastic_displacement"]
    for share in shares:
        below = replace(scene, load=Load(share * scene.load.final))
        starts = [None, share * peak.fields["pressure"]]
        for tolerance in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
            progress(f"start: load {share:g} of the peak, tolerance {tolerance:g}")
            rough = bem.solve(below, plastic_displacement=flow, tolerance=tolerance)
            starts.append(rough.fields["pressure"])
        for start in starts:
            found = bem.solve(below, plastic_displacement=flow, start=start)
            cost = {"start_residual": found.history[0], "pairs": found.cost[PAIRS]}
            rows.append({"load_over_peak": share} | cost | {"peak_pairs": peak.cost[PAIRS]})
    return pd.DataFrame(rows)


def _solved(model: str, scene: Scene) -> ContactResult:
    if model == "cap":
        return bem.solve(scene, area_tolerance=1e-5)
    flowing = replace(scene.material, yield_stress=scene.material.hardness / CONSTRAINT)
    elastic = replace(flowing, hardness=math.inf)
    return fem_check.solve(replace(scene, material=elastic), law="j2", certified=False)


def _spent(result: ContactResult) -> np.ndarray:
    """Plastic work over the energy that the load has put in: what is stored and what is spent."""
    work, stored = (
        np.array([step.quantities[name] for step in result.steps])
        for name in ("plastic_work", "elastic_energy")
    )
    return np.asarray(work / (work + stored))


def _theory(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Areas and mean gaps up to the load of the scene, and down on the flattened surface."""
    up = Theory.of_scene(scene, energy_reduction=GAMMA, spectrum="surface")
    flat = flattened_roughness(up, scene.load.final)
    down = replace(up, roughness=flat, hardness=math.inf)
    rows = []
    for theory, shares in ((up, SHARES), (down, SHARES[-2::-1])):
        for share in shares:
            p = share * scene.load.final
            area = float(areas(theory.diffusion(p), p, theory.hardness).total)
            rows.append((area, mean_separation(theory, p)))
    area, gap = np.array(rows).T
    return area, gap


def unloading_over_loading(table: pd.DataFrame, figure: str) -> pd.DataFrame:
    """The mean of a figure on the way down over that on the way up, by model and load."""
    means = table.groupby(["model", "load_over_peak", "branch"], sort=False)[figure].mean()
    both = means.unstack("branch").dropna()
    return (both["down"] / both["up"]).rename("ratio").reset_index()


def draw(table: pd.DataFrame, figure: str, label: str, caption: str, log: str) -> Chart:
    """Draw a figure on the way up and down against the load."""
    means = mean_with_interval(table, figure, ["model", "branch", "load_over_peak"])
    means["style"] = np.where(means["model"] == "theory", "curve", "points")
    ratios = unloading_over_loading(table, figure)
    light = ratios[ratios["load_over_peak"].isin((SHARES[0], 0.4))]
    return draw_table(
        means,
        Plot(
            ("load_over_peak", "mean pressure over its peak (–)"),
            (figure, label),
            series=("model", "branch"),
            log=log,
            ticks=SHARES,
        ),
        f"{caption} Down over up: {listed(light, '{model} {ratio:.2f} at {load_over_peak:g}')}.",
    )


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Draw area, mean gap and plastic share of all models, on small surfaces."""
    full = size == "full"
    points, seeds = (8, range(301, 317)) if full else (4, range(301, 304))
    table = cycle_table(points, 8, seeds, ("cap", "J2", "theory"), progress)
    of_scene = (
        f"means with 95 % intervals of {len(seeds)} surfaces of the paper's roughness, highest "
        f"over lowest wave number 8, peak p0/(E* xi) = 0.05, hardness {HARDNESS:g} E* xi, {points} "
        f"points a shortest wave; J2 with yield stress hardness/{CONSTRAINT:g}; the theory comes "
        "down on the surface that it has flattened."
    )
    spent = table[table["model"] != "theory"]
    return (
        draw(table, AREA, "contact area (–)", f"Contact area up and down, {of_scene}", "xy"),
        draw(table, GAP, "mean gap over rms height (–)", f"Mean open gap, {of_scene}", "x"),
        draw(
            spent,
            SPENT,
            "plastic work over all energy (–)",
            f"Share of the energy in the body that flow has spent, {of_scene}",
            "x",
        ),
    )
