"""The study of the finite elements: elements, meshes, depth, load steps, paths."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

import fem_check
from epcontact.errors import NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.plot import Plot
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.studies import paper_scene as paper
from epcontact.studies.cost import pair_times
from epcontact.studies.frame import Charts, Ints, Say, listed, root_mean_square, rows, study
from epcontact.surfaces.power_spectrum import surface_moments
from fem_check.limit_load import STRIP_LIMIT, strip_punch

DEPTHS, WAVES = (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0), (1, 2, 4)
REFERENCE = "uncertainty of the reference"
#: Series of which the legend tells the order.
_ORDERS = ("mean dilatation", "full integration", "raw", "corrected", "mean gap")
_solved = partial(fem_check.solve, law="j2", certified=False)


@study(
    "fem",
    elements=(2, 3, 4, 6, 8),
    nodes=(3, 4, 6, 8, 12, 16),
    steps=(1, 2, 4, 8, 16, 32),
    sample=(8, range(7, 11)),
    paths=([(32, 16), (64, 24), (128, 32)], range(5, 9)),
)
def fem(
    say: Say,
    elements: Ints = (2, 3),
    nodes: Ints = (3, 4, 6, 10),
    steps: Ints = (1, 2, 4, 8),
    sample: tuple[int, Ints] = (4, range(7, 9)),
    paths: tuple[Sequence[tuple[int, int]], Ints] = ([(16, 8), (32, 16), (64, 24)], range(5, 7)),
) -> Charts:
    """Errors and costs of finite elements: element, mesh, depth, increments, load path.

    The sample is the bandwidth of J2 bodies of the paper's scene (nu = 0.3), and the seeds of their
    surfaces, over which errors are root mean squares; the references are the last of the nodes
    (corrected) and of the steps, which is a path of its own and not exact.  Limit loads are those
    of a smooth strip punch, against (2 + pi) k, where the solver converges; compliances of the
    bonded block are on 64 nodes.  The paths are meshes (nodes a side, layers) of J2 load paths in 4
    steps, and their seeds; the finer ones have more roughness.
    """

    def errors(x: tuple[str, str], label: str, series: str, ticks: Sequence[float]) -> Plot:
        y, styles = ("relative_error", label), {REFERENCE: "curve"}
        return Plot(x, y, (series,), styles, log="xy", ticks=ticks, orders=_ORDERS)

    table = rows(say, punch_error, formulation=_ORDERS[:2], elements=elements)
    x = ("elements", "elements to the half-width of the punch (–)")
    plot = errors(x, "relative error of the limit load (–)", "formulation", elements)
    yield plot, table, "Limit load by bricks with mean dilatation, and with all strain integrated"
    x = ("nodes_per_wavelength", "nodes per shortest wavelength (–)")
    plot = errors(x, "relative error of the contact area (–)", "kind", nodes[:-1])
    yield plot, mesh_errors(say, nodes, *sample), "Contact area against the mesh"
    table = rows(say, depth_error, waves=WAVES, depth_over_period=DEPTHS)
    table["series"] = table["waves"].map({1: "one wave a period"}.get)
    table["series"] = table["series"].fillna(table["waves"].map("{} waves a period".format))
    x = ("depth_over_period", "depth over the period (–)")
    plot = errors(x, "compliance over half-space's, less 1 (–)", "series", DEPTHS)
    yield plot, table, "Compliance of the bonded block to long waves, over 2/(E* q)"
    table = step_errors(say, steps, *sample)
    plot = errors(("load_steps", "load steps (–)"), "relative error (–)", "quantity", steps[:-1])
    counts = listed(table[table["quantity"] == "mean gap"], "{load_steps}: {cg_iterations:.0f}")
    yield plot, table, f"Raw contact area and mean gap by steps. CG iterations of paths: {counts}"
    costs = path_costs(say, *paths)
    x, y = ("nodes", "nodes a side (–)"), ("iterations", "iterations of the load path (–)")
    plot = Plot(x, y, ("solver",), log="x", ticks=costs["nodes"].tolist())
    table = costs.melt("nodes", ["conjugate gradients", "Newton"], "solver", "iterations")
    times = listed(costs, "{nodes:.0f}: {time_in_fft_pairs:.3g}")
    yield plot, table, f"J2 load paths. Time in FFT pairs of 2048 x 2048 points, by nodes: {times}"


def plastic_scene(points_per_wavelength: int, seed: int, bandwidth: int) -> Scene:
    """The paper's scene as a J2 body with Poisson's ratio 0.3 of the same E*."""
    scene = paper.yielding(paper.rough_scene(points_per_wavelength, seed, bandwidth))
    material = replace(
        scene.material, young_modulus=paper.MODULUS * (1 - 0.3**2), poisson_ratio=0.3
    )
    return replace(scene, material=material)


def flat_scene(points: int) -> Scene:
    """The J2 body without roughness, on points x points nodes."""
    scene = plastic_scene(4, 7, 4)
    return replace(scene, surface=Surface(np.zeros((points, points)), scene.surface.periods))


def punch_error(formulation: str, elements: int) -> dict[str, float]:
    """Error of the limit load of a strip punch with so many elements in its half-width; NaN where
    the solver does not converge, as on elements that lock."""
    try:
        found = strip_punch(elements, mean_dilatation=formulation == "mean dilatation")[-1]
    except NotConverged:
        found = math.nan
    return {"relative_error": abs(found / STRIP_LIMIT - 1)}


def mesh_errors(say: Say, nodes: Ints, bandwidth: int, seeds: Ints) -> pd.DataFrame:
    """Errors of the J2 body's contact area against the corrected one on the finest mesh, rms over
    the surfaces (the reference's own uncertainty: mean)."""

    def row(seed: int) -> list[dict[str, Any]]:
        results = [_solved(plastic_scene(n, seed, bandwidth)) for n in nodes]
        exact, found = paper.area_of(results[-1], "total"), []
        worth = paper.area_of(results[-1], "total", "error") / exact
        for n, result in zip(nodes[:-1], results, strict=False):
            errors = {k: paper.area_of(result, "total", k) / exact - 1 for k in _ORDERS[2:4]}
            for kind, error in (errors | {REFERENCE: worth}).items():
                told = {"kind": kind, "nodes_per_wavelength": n, "relative_error": error}
                found.append(told | {"mean": error})
        return found

    by = ["kind", "nodes_per_wavelength"]
    errors = root_mean_square(rows(say, row, seed=seeds), "relative_error", by)
    is_reference = errors["kind"] == REFERENCE
    return errors.assign(relative_error=errors["relative_error"].mask(is_reference, errors["mean"]))


def depth_error(waves: int, depth_over_period: float, points: int = 64) -> dict[str, float]:
    """The block's compliance of a wave over the half-space's 2/(E* q), minus 1."""
    scene = flat_scene(points)
    period = scene.surface.periods[0]
    compliance = fem_check.surface_compliance(scene, depth=depth_over_period * period)[0, waves]
    exact = 2 / (effective_modulus(scene.material) * 2 * math.pi / period * waves)
    return {"relative_error": abs(float(compliance) / exact - 1)}


def step_errors(say: Say, steps: Ints, bandwidth: int, seeds: Ints) -> pd.DataFrame:
    """Errors of the J2 body's raw contact area and mean gap against those with the most load
    increments, rms over the surfaces, and the mean of the CG iterations."""

    def row(seed: int) -> list[dict[str, Any]]:
        scene, found = plastic_scene(6, seed, bandwidth), []
        results = [_solved(scene, steps=count) for count in steps]
        values = {
            "contact area": [paper.area_of(result, "total", "raw") for result in results],
            "mean gap": [result.final.quantities["mean_gap"] for result in results],
        }
        for (quantity, value), i in product(values.items(), range(len(steps) - 1)):
            told = {"relative_error": value[i] / value[-1] - 1} | {
                "cg_iterations": results[i].cost["cg_iterations"]
            }
            found.append({"quantity": quantity, "load_steps": steps[i]} | told)
        return found

    by = ["quantity", "load_steps"]
    return root_mean_square(rows(say, row, seed=seeds), "relative_error", by)


def speed_scene(nodes: int, *, load: float = 0.05, seed: int = 5) -> Scene:
    """A self-affine J2 scene of unit period with eight nodes to its shortest wave.  `load` is the
    mean pressure in units of E* xi, which is 1 at the rms slope of 0.05; the yield stress is 0.2,
    and nu = 0.3."""
    frequency = np.abs(np.fft.fftfreq(nodes, 1 / nodes))
    q = np.hypot(frequency[:, None], frequency[None, :])
    inside = (q > 0) & (q <= nodes // 8)
    power = np.where(inside, np.where(inside, q, 1.0) ** -1.8, 0.0)
    noise = np.random.default_rng(seed).standard_normal(q.shape)
    heights = np.fft.ifftn(power * np.fft.fftn(noise)).real
    slope = surface_moments(Surface(heights, (1.0, 1.0))).rms_slope
    surface = Surface(heights * 0.05 / slope, (1.0, 1.0), seed=seed)
    return Scene(surface, Material((1 - 0.3**2) / 0.05, 0.3, yield_stress=0.2), Load(load))


def path_costs(say: Say, meshes: Sequence[tuple[int, int]], seeds: Ints) -> pd.DataFrame:
    """Means over the surfaces of load paths in four increments on meshes (nodes a side, layers):
    the iterations of the path by their names, and time_in_fft_pairs of 2048 x 2048 points."""

    def row(mesh: tuple[int, int], seed: int) -> dict[str, float]:
        scene, pair = speed_scene(mesh[0], seed=seed), pair_times((2048, 2048), 1, 3)[1]
        begun = time.thread_time()  # other programs on the machine hardly disturb it
        spent = _solved(scene, layers=mesh[1], steps=4, threads=1).cost
        return {
            "nodes": mesh[0],
            "conjugate gradients": spent["cg_iterations"],
            "Newton": spent["newton_steps"],
            "time_in_fft_pairs": (time.thread_time() - begun) / pair,
        }

    _solved(speed_scene(16), layers=8, steps=4, threads=1)  # compiled before it is timed
    table = rows(say, row, mesh=meshes, seed=seeds)
    return table.groupby("nodes", sort=False).mean(numeric_only=True).reset_index()
