"""The study of the finite elements: elements, meshes, depth, load steps, paths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import pandas as pd

import fem_check
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.plot import Axis, Plot
from epcontact.scene import Body
from epcontact.studies.cost import pair_times, timed
from epcontact.studies.frame import (
    Charts,
    Ints,
    Say,
    list_rows,
    root_mean_square,
    study,
    tabulate,
)
from epcontact.studies.hardness import PERIOD, model_scene
from epcontact.studies.paper_scene import area_of, solve_j2

#: Depths of the block over the period, and numbers of waves in a period.
DEPTHS = (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
WAVES = (1, 2, 4)
ERROR = "relative_error"
REFERENCE = "uncertainty of the reference"
#: Series whose legend shows the observed order of convergence.
_ORDERS = ("raw", "corrected", "mean gap")
#: A J2 body of E* xi/sigma_Y = 5 and nu = 0.3; its arguments are the seed, the nodes a
#: side and the number of the shortest waves in a period.
_j2_scene = partial(model_scene, 5.0, 0.3)


@study(
    "fem",
    nodes=(3, 4, 6, 8, 12, 16),
    steps=(1, 2, 4, 8, 16, 32),
    sample=(8, range(7, 11)),
    paths=([(32, 16), (64, 24), (128, 32)], range(5, 9)),
)
def fem(
    say: Say,
    nodes: Ints = (3, 4, 6, 10),
    steps: Ints = (1, 2, 4, 8),
    sample: tuple[int, Ints] = (4, range(7, 9)),
    paths: tuple[Sequence[tuple[int, int]], Ints] = (
        [(16, 8), (32, 16), (64, 24)],
        range(5, 7),
    ),
) -> Charts:
    """Errors and costs of finite elements: mesh, depth, increments, load path.

    The sample is how many of the shortest waves are in a period of J2 bodies (E*
    xi/sigma_Y = 5, nu = 0.3), and the seeds of their surfaces, over which errors are
    root mean squares; the references are the last of the nodes (corrected) and of the
    steps, which is a path of its own and not exact.  Compliances of the bonded block
    are on 64 nodes.  The paths are meshes (nodes a side, layers) of such
    bodies with eight nodes to the shortest wave, in 4 steps, and their seeds.
    """
    yield _mesh_chart(say, nodes, sample)
    yield _depth_chart(say)
    yield _steps_chart(say, steps, sample)
    yield _paths_chart(say, *paths)


#: A look, a table and a caption.
_Chart = tuple[Plot, pd.DataFrame, str]


def _error_plot(
    x: Axis, label: str, ticks: Sequence[float], series: str = "series"
) -> Plot:
    """Return the look of a chart of relative errors with two logarithmic axes.

    Args:
        x: Column of the horizontal axis, and its label.
        label: Label of the vertical axis.
        ticks: Values of x with a tick.
        series: Column that names the series.
    """
    styles = {REFERENCE: "curve"}
    y = Axis(ERROR, label)
    return Plot(
        x,
        y,
        (series,),
        styles,
        log="xy",
        ticks=ticks,
        orders=_ORDERS,
    )


def _mesh_chart(
    say: Say,
    nodes: Ints,
    sample: tuple[int, Ints],
) -> _Chart:
    """Return the chart of the error of contact areas over nodes per shortest wave.

    The last of `nodes` is the reference.  `sample` is the number of the shortest waves
    in a period, and the seeds of the surfaces.
    """
    waves, seeds = sample
    solved = tabulate(
        say, solve_sample, seed=seeds, waves=[waves], nodes_per_wavelength=nodes
    )
    x = Axis("nodes_per_wavelength", "nodes per shortest wavelength (–)")
    references = {"raw": "corrected", "corrected": "corrected"}
    table = errors_of(solved, x.column, references)
    finest = solved[solved[x.column] == nodes[-1]]
    relative = finest["error_estimate"] / finest["corrected"]
    uncertainty = math.sqrt((relative**2).mean())
    level = pd.DataFrame(
        {
            x.column: nodes[:-1],
            "series": REFERENCE,
            ERROR: uncertainty,
        }
    )
    plot = _error_plot(x, "relative error of the contact area (–)", nodes[:-1])
    caption = "How fine must the mesh be for the contact area?"
    return plot, pd.concat([table, level]), caption


def _depth_chart(say: Say) -> _Chart:
    """Return the chart of the error of the block's compliance over its depth."""
    table = tabulate(say, depth_error, waves=WAVES, depth_over_period=DEPTHS)
    table["series"] = table["waves"].map("waves in a period: {}".format)
    x = Axis("depth_over_period", "depth over the period (–)")
    plot = _error_plot(x, "compliance over half-space's, less 1 (–)", DEPTHS)
    caption = (
        "How deep must the block be? The compliance of a half-space is 2/(E* q) for "
        "waves of the wave number q."
    )
    return plot, table, caption


def _steps_chart(
    say: Say,
    steps: Ints,
    sample: tuple[int, Ints],
) -> _Chart:
    """Return the chart of errors of area and mean gap over the number of load steps.

    The last of `steps` is the reference.  `sample` is the number of the shortest waves
    in a period, and the seeds of the surfaces.
    """
    waves, seeds = sample
    solved = tabulate(
        say,
        solve_sample,
        seed=seeds,
        waves=[waves],
        load_steps=steps,
    )
    solved = solved.rename(columns={"raw": "contact area"})
    x = Axis("load_steps", "load steps (–)")
    references = {"contact area": "contact area", "mean gap": "mean gap"}
    table = errors_of(solved, x.column, references)
    plot = _error_plot(x, "relative error (–)", steps[:-1])
    once = table[table["series"] == "mean gap"]
    counts = list_rows(once, "{load_steps}: {cg_iterations:.0f}")
    caption = (
        "How many load steps does J2 flow need? The area is raw. CG iterations of the "
        f"paths by their steps: {counts}."
    )
    return plot, table, caption


def _paths_chart(
    say: Say,
    meshes: Sequence[tuple[int, int]],
    seeds: Ints,
) -> _Chart:
    """Return the chart of the iterations of load paths over the nodes a side.

    `meshes` are pairs of nodes a side and layers, and `seeds` those of the surfaces.
    """
    costs = path_costs(say, meshes, seeds)
    x = Axis("nodes", "nodes a side (–)")
    y = Axis("iterations", "iterations of the load path (–)")
    plot = Plot(
        x,
        y,
        ("solver",),
        log="x",
        ticks=costs["nodes"].tolist(),
    )
    solvers = ["conjugate gradients", "Newton"]
    table = costs.melt("nodes", solvers, "solver", "iterations")
    times = list_rows(costs, "{nodes:.0f}: {time_in_fft_pairs:.3g}")
    caption = (
        "How does the work of a J2 load path grow with the mesh? Time in FFT pairs of "
        f"2048 x 2048 points, by nodes: {times}."
    )
    return plot, table, caption


def solve_sample(
    seed: int, waves: int, nodes_per_wavelength: int = 6, load_steps: int = 10
) -> dict[str, float]:
    """Return areas, mean gap (m) and CG iterations of the load path of a J2 body.

    Args:
        seed: Seed of the surface.
        waves: Number of the shortest waves in a period.
        nodes_per_wavelength: Nodes per shortest wavelength.
        load_steps: Number of load steps.
    """
    scene = _j2_scene(seed, nodes_per_wavelength * waves, waves)
    result = solve_j2(scene, steps=load_steps)
    return {
        "raw": area_of(result, "total", "raw"),
        "corrected": area_of(result, "total"),
        "error_estimate": area_of(result, "total", "error"),
        "mean gap": result.final.quantities["mean_gap"],
        "cg_iterations": result.cost["cg_iterations"],
    }


def errors_of(
    solved: pd.DataFrame, setting: str, references: Mapping[str, str]
) -> pd.DataFrame:
    """Return relative errors as root mean squares over the surfaces.

    Args:
        solved: A row for each seed and setting, with cg_iterations, whose means are in
            the result.
        setting: The column of the setting; rows of each seed end with the reference.
        references: Names of the columns with errors, each with the column that is its
            reference at the last setting.

    Returns:
        Columns series, `setting`, ERROR and cg_iterations, without the last setting.
    """
    last = solved.groupby("seed").transform("last")
    errors = {}
    for name, reference in references.items():
        errors[name] = solved[name] / last[reference] - 1
    with_errors = solved.assign(**errors)
    before_last = with_errors[solved[setting] != last[setting]]
    identifiers = ["seed", setting, "cg_iterations"]
    table = before_last.melt(identifiers, list(references), "series", ERROR)
    return root_mean_square(table, ERROR, ["series", setting])


def depth_error(waves: int, depth_over_period: float) -> dict[str, float]:
    """Return the relative error of the compliance of a finite-element block.

    The compliance of a half-space, 2/(E* q) at the wave number q, is exact.

    Args:
        waves: Number of waves in a period, which is q times the period over 2 pi.
        depth_over_period: Depth of the block over the period.
    """
    layer = Body("bonded_layer", depth_over_period * PERIOD)
    scene = replace(_j2_scene(7, 64), body=layer)
    compliance = fem_check.surface_compliance(scene)[0, waves]
    q = 2 * math.pi / PERIOD * waves
    exact = 2 / (effective_modulus(scene.material) * q)
    return {ERROR: abs(float(compliance) / exact - 1)}


def path_costs(
    say: Say, meshes: Sequence[tuple[int, int]], seeds: Ints
) -> pd.DataFrame:
    """Return the cost of load paths in four increments, as means over the surfaces.

    Args:
        say: Called with the arguments before each path.
        meshes: Nodes a side and layers of each mesh.
        seeds: Seeds of the surfaces.

    Returns:
        Columns nodes, "conjugate gradients" and "Newton" (iterations of the path), and
        time_in_fft_pairs of 2048 x 2048 points (processor time).
    """

    def row(mesh: tuple[int, int], seed: int) -> dict[str, float]:
        """Return the columns of `path_costs` for one load path.

        `mesh` is the pair of nodes a side and layers, `seed` that of the surface.
        """
        nodes, layers = mesh
        _, time_of_pair = pair_times((2048, 2048), 1, 3)
        scene = _j2_scene(seed, nodes, nodes // 8)
        result, (_, processor) = timed(
            lambda: solve_j2(scene, layers=layers, steps=4, threads=1)
        )
        return {
            "nodes": nodes,
            "conjugate gradients": result.cost["cg_iterations"],
            "Newton": result.cost["newton_steps"],
            "time_in_fft_pairs": processor / time_of_pair,
        }

    # Kernels are compiled before they are timed.
    solve_j2(
        _j2_scene(5, 16, 2),
        layers=8,
        steps=4,
        threads=1,
    )
    table = tabulate(say, row, mesh=meshes, seed=seeds)
    return table.groupby("nodes", sort=False).mean(numeric_only=True).reset_index()
