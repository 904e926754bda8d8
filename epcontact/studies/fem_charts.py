"""The charts of `epcontact.studies.fem`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves, with_orders
from epcontact.results import FloatArray

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.studies.fem import LinearSolve, PathGrowth


def draw_punch(counts: Sequence[int], errors: Mapping[str, FloatArray]) -> Chart:
    """Error of the limit load against elements to the punch's half-width."""
    series = [Series(name, counts, error) for name, error in errors.items()]
    lost = [name for name, error in errors.items() if np.isnan(error).any()]
    missing = f" Not converged where no point is: {', '.join(lost)}." if lost else ""
    return curves(
        series,
        x="elements to the half-width of the punch (–)",
        y="relative error of the limit load (–)",
        columns=("elements", "relative_error"),
        caption="Limit load of a smooth strip punch in plane strain, J2 body of Poisson's ratio "
        "0.3, by bricks with mean dilatation and with full integration of all strain, against "
        "Prandtl's exact (2 + pi) k. The former misses by half an element's width, of first "
        f"order; the latter locks.{missing}",
        log="xy",
        labels=with_orders(series, list(errors), sign=-1),
        ticks=counts,
    )


def draw_meshes(
    points: Sequence[int],
    errors: Mapping[str, FloatArray],
    claimed: float,
    finest: int,
    sample: tuple[int, int],
) -> Chart:
    """Error of the J2 contact area against nodes per wavelength; sample: bandwidth, surfaces."""
    series = [Series(name, points, error) for name, error in errors.items()]
    bound = Series("uncertainty of the reference", points, np.full(len(points), claimed), line=True)
    return curves(
        [*series, bound],
        x="nodes per shortest wavelength (–)",
        y="relative error of the contact area (–)",
        columns=("nodes_per_wavelength", "relative_error"),
        caption=f"Contact area of the J2 body, {_scene(sample)}, against the mesh, which is as "
        f"fine at the surface in depth. Reference: the corrected area at {finest} nodes, uncertain "
        f"by {claimed:.1e} of itself.",
        log="xy",
        labels=with_orders(series, list(errors), sign=-1),
        ticks=points,
    )


def draw_depths(depths: Sequence[float], waves: Sequence[int], errors: FloatArray) -> Chart:
    """Departure of the block's compliance from the half-space's against its depth."""
    series = [
        Series(f"{wave} waves a period" if wave > 1 else "one wave a period", depths, error)
        for wave, error in zip(waves, errors, strict=True)
    ]
    return curves(
        series,
        x="depth of the block over the period (–)",
        y="compliance over half-space's, less 1 (–)",
        columns=("depth_over_period", "relative_error"),
        caption="How far the surface compliance of the bonded finite-element block departs from "
        "that of the half-space, 2/(E* q), against its depth, for the longest waves, 64 nodes a "
        "period, Poisson's ratio 0.3. What no depth removes is the discretisation of each wave.",
        log="xy",
        ticks=depths,
    )


def draw_steps(
    steps: Sequence[int],
    errors: Mapping[str, FloatArray],
    iterations: FloatArray,
    sample: tuple[int, int],
) -> Chart:
    """Errors of the J2 body against load increments, their cost in the caption.

    steps: the last of them is the reference and has no error.
    """
    *steps, reference = steps
    series = [Series(name, steps, error) for name, error in errors.items()]
    cost = ", ".join(f"{s}: {n:.0f}" for s, n in zip(steps, iterations, strict=True))
    return curves(
        series,
        x="load steps (–)",
        y="relative error (–)",
        columns=("load_steps", "relative_error"),
        caption=f"Raw contact area and mean gap of the J2 body, {_scene(sample)}, 6 nodes per "
        f"shortest wavelength, against the number of load increments; reference: {reference} of "
        "them, which is a path of its own and no exact value: what is left there is of its order."
        f" CG iterations of the whole path, mean: {cost}. An error of zero (no "
        "node changed) is drawn as an open mark at the bottom.",
        log="xy",
        labels=with_orders(series, ["mean gap"], sign=-1),
        zeros=True,
        ticks=steps,
    )


def draw_linear_solvers(blocks: Sequence[LinearSolve]) -> Chart:
    """Time of a linear solve in products with the matrix, against unknowns."""
    unknowns = [block.unknowns for block in blocks]
    series = [
        Series(name, unknowns, [block.seconds[name] / block.product for block in blocks])
        for name in blocks[0].seconds
    ]
    worst = ", ".join(
        f"{name} {max(b.residuals[name] for b in blocks):.0e}" for name in blocks[0].residuals
    )
    return curves(
        series,
        x="unknowns (–)",
        y="time in products with the assembled matrix (–)",
        columns=("unknowns", "time_in_products"),
        caption="One linear solve of an elastic block under random forces: Fourier transforms "
        "along the surface and elimination over the levels (its factorisation, made once a "
        "block, left out), sparse factorisation (SuperLU) and conjugate gradients with the "
        "diagonal. Time in products of the assembled sparse matrix with a vector, timed in the "
        f"same run on one thread. Largest relative residuals: {worst}.",
        log="xy",
    )


def draw_paths(growth: PathGrowth, surfaces: int) -> Chart:
    """Iterations of a whole load path against the mesh, its times in the caption."""
    nodes = growth.nodes
    series = [
        Series("conjugate gradients", nodes, growth.cg),
        Series("Newton", nodes, growth.newton),
    ]
    times = ", ".join(f"{n}: {t:.3g}" for n, t in zip(nodes, growth.fft_pairs, strict=True))
    return curves(
        series,
        x="nodes a side (–)",
        y="iterations of the load path (–)",
        columns=("nodes", "iterations"),
        caption="A J2 load path of 4 steps to p0/(E* xi) = 0.05, mean of "
        f"{surfaces} surfaces whose shortest wave has 8 nodes, so that a finer mesh has more "
        "roughness; yield_stress/(E* xi) "
        "= 0.2, Poisson's ratio 0.3. From the coarsest to the finest mesh the CG iterations grow "
        f"by {growth.cg[-1] / growth.cg[0]:.2f}. Time of a path in bare FFT pairs of 2048 x 2048 "
        f"points, by nodes a side: {times}.",
        log="x",
        ticks=nodes,
    )


def _scene(sample: tuple[int, int]) -> str:
    bandwidth, surfaces = sample
    return (
        f"{surfaces} surfaces (root mean square) of the paper's roughness, 1/{bandwidth} of its "
        "longest wave being the shortest, and load, yield_stress/(E* xi) = 0.2, Poisson's ratio "
        "0.3"
    )
