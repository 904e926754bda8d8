"""What a grid point buys: errors of raw and corrected areas against resolution and against cost.

One roughness on finer and finer grids.  The reference is the corrected area of the finest grid;
its own estimated error is drawn with it, and no error below it means anything.  Four figures of
each grid are judged: the raw areas (share of grid points), these extrapolated to a vanishing
spacing from two grids (2 A(n) - A(n/2), as their error is of first order), the published
perimeter correction, and the corrected areas; beside them the error the latter claim of
themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.curves import observed_order
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves, with_orders
from epcontact.results import Areas, FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart

KINDS = ("raw", "raw, extrapolated", "perimeter correction", "corrected")
CLAIMED = "claimed by the corrected"


@dataclass(frozen=True)
class ResolutionErrors:
    """Errors of one part of the area (total, elastic or plastic), relative to the reference.

    points: (n,) grid points per shortest wavelength; work: (n,) points transformed, the sum over
    all grids of a solve of FFT pairs times points, mean over the surfaces.
    errors: (n,) by the names of KINDS and CLAIMED, root mean square over the surfaces; NaN where
    there is none.  reference_error: what the finest grid's areas claim, relative.
    """

    part: str
    points: FloatArray
    work: FloatArray
    errors: dict[str, FloatArray]
    reference_error: float
    surfaces: int


@dataclass(frozen=True)
class _Solved:
    areas: dict[str, Areas]
    work: float


def measure(
    points: Sequence[int], finest: int, bandwidth: int, seeds: Sequence[int], progress: Progress
) -> tuple[ResolutionErrors, ...]:
    """Total, elastic and plastic area of surfaces on grids of `points` per shortest wavelength.

    finest: points per shortest wavelength of the reference.
    """
    solved: list[list[_Solved]] = []
    for seed in seeds:
        progress(f"resolution: seed {seed}")
        solved.append([_solve(p, seed, bandwidth) for p in (*points, finest)])
    return tuple(_errors(part, points, solved) for part in scenes.PARTS)


def _solve(points: int, seed: int, bandwidth: int) -> _Solved:
    from epcontact import bem
    from epcontact.bem.areas.rim_correction import perimeter_areas

    scene = scenes.rough_scene(points, seed, bandwidth)
    result = bem.solve(scene, area_tolerance=1e-6)
    areas = dict(result.final.areas)
    areas["perimeter"] = perimeter_areas(result.fields["pressure"], scene.material.hardness)[1]
    work = result.cost["equivalent_fft_pairs"] * result.cost["unknowns"]
    return _Solved(areas, work)


def _errors(
    part: str, points: Sequence[int], solved: Sequence[Sequence[_Solved]]
) -> ResolutionErrors:
    def table(kind: str) -> FloatArray:
        return np.array([[getattr(one.areas[kind], part) for one in row] for row in solved])

    def relative(values: FloatArray) -> FloatArray:
        mean_square = ((values / reference - 1) ** 2).mean(axis=0)
        return np.asarray(np.sqrt(mean_square))

    raw, corrected, claimed = table("raw"), table("corrected"), table("error")
    reference = corrected[:, -1:]
    extrapolated = np.full_like(raw, math.nan)
    for i, p in enumerate(points):
        if 2 * p in points:
            j = list(points).index(2 * p)
            extrapolated[:, j] = 2 * raw[:, j] - raw[:, i]
    tables = (raw, extrapolated, table("perimeter"), corrected)
    errors = {k: relative(t)[:-1] for k, t in zip(KINDS, tables, strict=True)}
    errors[CLAIMED] = np.sqrt(((claimed / reference) ** 2).mean(axis=0))[:-1]
    return ResolutionErrors(
        part=part,
        points=np.asarray(points, dtype=np.float64),
        work=np.array([[one.work for one in row] for row in solved]).mean(axis=0)[:-1],
        errors=errors,
        reference_error=float((claimed[:, -1:] / reference).mean()),
        surfaces=len(solved),
    )


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Errors against points per wavelength and against work, of the total and the plastic area."""
    fast = size == "fast"
    points, finest = (3, 4, 6, 8, 12, 16), 32
    bandwidth, seeds = (32, range(7, 13)) if fast else (64, range(7, 15))
    found = measure(points, finest, bandwidth, seeds, progress)
    return tuple(
        chart for one in found if one.part != "elastic" for chart in draw_errors(one, finest)
    )


def draw_errors(found: ResolutionErrors, finest: int) -> tuple[Chart, Chart]:
    """Error against grid spacing with its order, and against work."""
    where = (
        f"Error of the {found.part} contact area of the capped body, root mean square over "
        f"{found.surfaces} surfaces, relative to the corrected area at {finest} points per "
        f"shortest wavelength, which is uncertain by {found.reference_error:.1e}"
    )
    series = [
        Series(kind, found.points, error, line=kind == CLAIMED)
        for kind, error in found.errors.items()
    ]
    bound = np.full_like(found.points, found.reference_error)
    error_label = f"relative error of the {found.part} area (–)"
    first = curves(
        [*series, Series("uncertainty of the reference", found.points, bound, line=True)],
        x="points per shortest wavelength (–)",
        y=error_label,
        columns=("points_per_wavelength", "relative_error"),
        caption=f"{where}. {_told(found)}",
        log="xy",
        labels=with_orders(series, KINDS, sign=-1),
        ticks=found.points.tolist(),
    )
    second = curves(
        [Series(k, _work(k, found), e) for k, e in found.errors.items() if k != CLAIMED],
        x="work: FFT pairs × grid points (–)",
        y=error_label,
        columns=("work_points_transformed", "relative_error"),
        caption=f"{where}; against the work of a solve: FFT pairs of all its grids, each times "
        "its points. Extrapolation pays for both of its grids.",
        log="xy",
        pareto=KINDS,
    )
    return first, second


def _work(kind: str, found: ResolutionErrors) -> FloatArray:
    if kind != "raw, extrapolated":
        return found.work
    half = np.interp(found.points / 2, found.points, found.work)
    return found.work + half


def _told(found: ResolutionErrors) -> str:
    def at(kind: str, points: int) -> str:
        index = np.flatnonzero(found.points == points)
        return f"{100 * found.errors[kind][index[0]]:.2g} %" if index.size else "not measured"

    order = observed_order(1 / found.points, found.errors["raw"])
    return (
        f"At 4 points: raw {at('raw', 4)}, perimeter correction {at('perimeter correction', 4)}, "
        f"corrected {at('corrected', 4)}; raw at 16 points: {at('raw', 16)}. Observed order of "
        f"the raw area: {order:.2f}."
    )
