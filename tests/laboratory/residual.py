"""The topography that a load leaves: its power spectrum and its skewness.

`python -m laboratory.residual [--full]` draws the charts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from epcontact.output.charts.plot import Axis, Plot
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Load, Scene, Surface
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    Study,
    list_rows,
    mean_with_interval,
    tabulate,
)
from epcontact.studies.metal import power_kept_by_theory
from epcontact.surfaces import power_by_octave, residual_surface, topography
from laboratory import charts


def solve_model(model: str, scene: Scene) -> ContactResult:
    """Solve a scene by a model: a pressure cap or J2 flow.

    Args:
        model: "cap" (boundary elements with the scene's hardness) or "J2" (finite
            elements, with a yield stress of the hardness over TABOR).
        scene: A scene with a finite hardness.

    Raises:
        NotConverged: The solve does not converge.
    """
    if model == "cap":
        return paper.solve_bem(scene)
    return paper.solve_j2(paper.yielding(scene))


def surface_after(model: str, scene: Scene) -> Surface:
    """Return the unloaded surface after the load of a scene.

    `model` is "cap", whose surface is lowered by the plastic displacement under the
    load, or "J2", whose finite elements are unloaded.
    """
    path = (scene.load.final, 0.0) if model == "J2" else scene.load.final
    result = solve_model(model, replace(scene, load=Load(path)))
    return residual_surface(scene.surface, result)


def changes_by_load(model: str, scene: Scene) -> tuple[FloatArray, dict[str, float]]:
    """Return how a load changes the topography of a surface.

    Args:
        model: "cap" (boundary elements) or "J2" (finite elements).
        scene: The scene with the surface and the load.

    Returns:
        The fraction of each octave's slope variance that is left, (octaves,), and
        changes of the heights: of skewness and kurtosis the difference, of rms height,
        slope and curvature the ratio.
    """
    left = surface_after(model, scene)
    _, power_before = power_by_octave(scene.surface)
    _, power_after = power_by_octave(left)
    kept = power_after / np.where(power_before > 0, power_before, np.nan)
    before = topography(scene.surface)
    after = topography(left)
    changes = {
        "skewness_change": after.skewness - before.skewness,
        "kurtosis_change": after.excess_kurtosis - before.excess_kurtosis,
    }
    for name in ("rms_height", "rms_slope", "rms_curvature"):
        changes[name] = getattr(after, name) / getattr(before, name)
    return kept, changes


def residual(
    say: Say,
    points: int = 4,
    wide: int = 64,
    seeds: Ints = range(201, 205),
    narrow: int = 8,
    hardnesses: Sequence[float] = (0.6, 0.3, 0.16),
) -> Charts:
    """Power spectrum and skewness of the surface that a load leaves, by every method.

    The load is the paper's.  A cap lowers the surface by the plastic displacement of
    boundary elements, J2 (finite elements, yield stress = hardness/3) by that which
    remains after unloading, the theory (gamma = 0.536) has the effective spectrum C [1
    - (A_pl sigma_P/p)^6] and says nothing about the distribution of heights.  The
    experiment of Tiwari, Wang, Mueser and Persson (Lubricants 7, 90 (2019)) left short
    waves and the symmetry of heights nearly as they were.
    """
    x = Axis("wavenumber_over_lowest", "wave number over the lowest (–)")
    y = Axis("power_kept", "power after over before (–)")
    series = ["model", "hardness"]

    def row(
        model: str, hardness: float, seed: int, points: int, bandwidth: int
    ) -> Rows:
        """Return a row for each octave of wave numbers of one surface.

        Args:
            model: "cap", "J2" or "theory".
            hardness: Hardness over E* xi.
            seed: Seed of the surface.
            points: Grid points per shortest wavelength.
            bandwidth: Number of the shortest waves in a period.
        """
        scene = paper.rough_scene(points, seed, bandwidth, hardness * paper.MODULUS)
        changes: dict[str, float] = {}
        if model == "theory":
            kept = power_kept_by_theory(scene)
        else:
            kept, changes = changes_by_load(model, scene)
        rows = []
        for octave in range(round(np.log2(bandwidth))):
            place = {x.column: 2.0 ** (octave + 0.5), y.column: float(kept[octave])}
            rows.append(place | changes)
        return rows

    look: dict[str, Any] = {
        "colour": "hardness",
        "mark": "model",
        "log": "x",
    }
    power = Plot(
        x,
        y,
        series,
        {"theory": "curve"},
        level=1.0,
        **look,
    )
    x_skewness = Axis(y.column, "power kept by the shortest octave (–)")
    skewness = Axis("skewness_change", "skewness after less before (–)")
    form = (
        "{model} at {hardness:g}: {kurtosis_change:+.3f}, {rms_height:.3f}, "
        "{rms_slope:.3f}, {rms_curvature:.3f}"
    )
    for models, grid, bandwidth in (
        (("cap", "J2"), points, narrow),
        (("cap", "theory"), 4, wide),
    ):
        table = tabulate(
            say,
            row,
            hardness=hardnesses,
            seed=seeds,
            model=models,
            points=[grid],
            bandwidth=[bandwidth],
        )
        in_words = table["hardness"].map("{:g} E* xi".format)
        caption = (
            f"Which waves does a load flatten ({' and '.join(models)})? Each point is "
            f"an octave of wave numbers; the bandwidth is {bandwidth}."
        )
        yield power, table.assign(hardness=in_words), caption

        shortest = table[table[x.column] == table[x.column].max()]
        means = mean_with_interval(shortest, skewness.column, series).dropna()
        shown = " and ".join(means["model"].unique())
        caption = (
            f"Does a load skew the heights ({shown})? The bandwidth is "
            f"{bandwidth}; change of the kurtosis, and rms height, slope and curvature "
            f"after over before: {list_rows(means, form)}."
        )
        yield Plot(x_skewness, skewness, ("model",), level=0.0), means, caption


FULL = {"points": 8, "wide": 256, "seeds": range(201, 217)}
STUDY = Study("residual", residual, FULL)

if __name__ == "__main__":
    charts.save(STUDY)
