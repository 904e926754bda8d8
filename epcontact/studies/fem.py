"""The study of the finite elements: elements, meshes, depth, load steps, paths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import pandas as pd

import fem_check
from epcontact.errors import NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.plot import Plot
from epcontact.scene import Body
from epcontact.studies.cost import pair_times, timed
from epcontact.studies.frame import (
    Charts,
    Ints,
    Say,
    listed,
    root_mean_square,
    rows,
    study,
)
from epcontact.studies.hardness import PERIOD, model_scene
from epcontact.studies.paper_scene import area_of, flowed
from fem_check.limit_load import STRIP_LIMIT, strip_punch

DEPTHS, WAVES = (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0), (1, 2, 4)
ERROR, REFERENCE = "relative_error", "uncertainty of the reference"
#: Series of which the legend tells the order.
_ORDERS = ("mean dilatation", "full integration", "raw", "corrected", "mean gap")
#: A J2 body of E* xi/sigma_Y = 5 and nu = 0.3, by its seed, nodes a side and waves in a
#: period.
_body = partial(model_scene, 5.0, 0.3)


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
    paths: tuple[Sequence[tuple[int, int]], Ints] = (
        [(16, 8), (32, 16), (64, 24)],
        range(5, 7),
    ),
) -> Charts:
    """Errors and costs of finite elements: element, mesh, depth, increments, load path.

    The sample is how many of the shortest waves are in a period of J2 bodies (E*
    xi/sigma_Y = 5, nu = 0.3), and the seeds of their surfaces, over which errors are
    root mean squares; the references are the last of the nodes (corrected) and of the
    steps, which is a path of its own and not exact.  Limit loads are those of a smooth
    strip punch, against (2 + pi) k, where the solver converges; compliances of the
    bonded block are on 64 nodes.  The paths are meshes (nodes a side, layers) of such
    bodies with eight nodes to the shortest wave, in 4 steps, and their seeds.
    """

    def errors(
        x: tuple[str, str], label: str, ticks: Sequence[float], series: str = "series"
    ) -> Plot:
        styles = {REFERENCE: "curve"}
        return Plot(
            x, (ERROR, label), (series,), styles, log="xy", ticks=ticks, orders=_ORDERS
        )

    table = rows(say, punch_error, formulation=_ORDERS[:2], elements=elements)
    x = ("elements", "elements to the half-width of the punch (–)")
    plot = errors(x, "relative error of the limit load (–)", elements, "formulation")
    yield (
        plot,
        table,
        "Limit load by bricks with mean dilatation, and with all strain integrated",
    )
    axes = {"seed": sample[1], "waves": [sample[0]]}
    known = rows(say, answer, **axes, nodes_per_wavelength=nodes)
    x = ("nodes_per_wavelength", "nodes per shortest wavelength (–)")
    table = errors_of(known, x[0], {"raw": "corrected", "corrected": "corrected"})
    finest = known[known[x[0]] == nodes[-1]]
    claim = math.sqrt(((finest["claim"] / finest["corrected"]) ** 2).mean())
    claims = pd.DataFrame({x[0]: nodes[:-1], "series": REFERENCE, ERROR: claim})
    plot = errors(x, "relative error of the contact area (–)", nodes[:-1])
    yield plot, pd.concat([table, claims]), "Contact area against the mesh"
    table = rows(say, depth_error, waves=WAVES, depth_over_period=DEPTHS)
    table["series"] = table["waves"].map("waves in a period: {}".format)
    x = ("depth_over_period", "depth over the period (–)")
    plot = errors(x, "compliance over half-space's, less 1 (–)", DEPTHS)
    yield plot, table, "Compliance of the bonded block to long waves, over 2/(E* q)"
    known = rows(say, answer, **axes, load_steps=steps).rename(
        columns={"raw": "contact area"}
    )
    x = ("load_steps", "load steps (–)")
    table = errors_of(
        known, x[0], {name: name for name in ("contact area", "mean gap")}
    )
    plot = errors(x, "relative error (–)", steps[:-1])
    counts = listed(
        table[table["series"] == "mean gap"], "{load_steps}: {cg_iterations:.0f}"
    )
    yield (
        plot,
        table,
        f"Raw contact area and mean gap by steps. CG iterations of paths: {counts}",
    )
    costs = path_costs(say, *paths)
    x, y = (
        ("nodes", "nodes a side (–)"),
        ("iterations", "iterations of the load path (–)"),
    )
    plot = Plot(x, y, ("solver",), log="x", ticks=costs["nodes"].tolist())
    table = costs.melt(
        "nodes", ["conjugate gradients", "Newton"], "solver", "iterations"
    )
    times = listed(costs, "{nodes:.0f}: {time_in_fft_pairs:.3g}")
    yield (
        plot,
        table,
        f"J2 load paths. Time in FFT pairs of 2048 x 2048 points, by nodes: {times}",
    )


def punch_error(formulation: str, elements: int) -> dict[str, float]:
    """Error of the limit load of a strip punch with so many elements in its half-width;
    NaN where the solver does not converge, as on elements that lock.
    """
    try:
        found = strip_punch(elements, mean_dilatation=formulation == "mean dilatation")[
            -1
        ]
    except NotConverged:
        found = math.nan
    return {ERROR: abs(found / STRIP_LIMIT - 1)}


def answer(
    seed: int, waves: int, nodes_per_wavelength: int = 6, load_steps: int = 10
) -> dict[str, float]:
    """The contact areas of the J2 body, its mean gap, and the CG iterations of its
    path.
    """
    result = flowed(_body(seed, nodes_per_wavelength * waves, waves), steps=load_steps)
    areas = {"raw": "raw", "corrected": "corrected", "claim": "error"}
    return {name: area_of(result, "total", kind) for name, kind in areas.items()} | {
        "mean gap": result.final.quantities["mean_gap"],
        "cg_iterations": result.cost["cg_iterations"],
    }


def errors_of(
    known: pd.DataFrame, setting: str, references: Mapping[str, str]
) -> pd.DataFrame:
    """The relative errors of columns, rms over the surfaces, at all but the last
    setting, at which each has a column for its reference; and the means of the CG
    iterations.
    """
    last = known.groupby("seed").transform("last")
    off = known.assign(
        **{name: known[name] / last[of] - 1 for name, of in references.items()}
    )
    table = off[known[setting] != last[setting]].melt(
        ["seed", setting, "cg_iterations"], [*references], "series", ERROR
    )
    return root_mean_square(table, ERROR, ["series", setting])


def depth_error(waves: int, depth_over_period: float) -> dict[str, float]:
    """The block's compliance of a wave over the half-space's 2/(E* q), minus 1."""
    layer = Body("bonded_layer", depth_over_period * PERIOD)
    scene = replace(_body(7, 64), body=layer)
    compliance = fem_check.surface_compliance(scene)[0, waves]
    exact = 2 / (effective_modulus(scene.material) * 2 * math.pi / PERIOD * waves)
    return {ERROR: abs(float(compliance) / exact - 1)}


def path_costs(
    say: Say, meshes: Sequence[tuple[int, int]], seeds: Ints
) -> pd.DataFrame:
    """Means over the surfaces of load paths in four increments on meshes (nodes a side,
    layers): the iterations of the path by their names, and time_in_fft_pairs of 2048 x
    2048 points.
    """

    def row(mesh: tuple[int, int], seed: int) -> dict[str, float]:
        (nodes, layers), pair = mesh, pair_times((2048, 2048), 1, 3)[1]
        scene = _body(seed, nodes, nodes // 8)
        result, (_, spent) = timed(
            lambda: flowed(scene, layers=layers, steps=4, threads=1)
        )
        told = {"nodes": nodes, "conjugate gradients": result.cost["cg_iterations"]}
        return told | {
            "Newton": result.cost["newton_steps"],
            "time_in_fft_pairs": spent / pair,
        }

    flowed(_body(5, 16, 2), layers=8, steps=4, threads=1)  # compiled before it is timed
    table = rows(say, row, mesh=meshes, seed=seeds)
    return table.groupby("nodes", sort=False).mean(numeric_only=True).reset_index()
