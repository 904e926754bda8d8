"""Studies of the error of contact areas: against the grid and its work, and against time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import pandas as pd

import fem_check
from epcontact import bem, persson
from epcontact.bem.areas.rim_correction import perimeter_areas
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.plot import Plot
from epcontact.scene import Scene
from epcontact.studies.frame import Charts, Say, root_mean_square, rows, study
from epcontact.studies.paper_scene import GAMMA, PARTS, area_of, rough_scene

KINDS = ("raw", "raw, extrapolated", "perimeter correction", "corrected")
CLAIMED, REFERENCE = "claimed by the corrected", "uncertainty of the reference"
#: What the curves of a chart of errors tell.
_STYLES = {CLAIMED: "curve", REFERENCE: "curve"}


@study("resolution", fast={"bandwidth": 32, "surfaces": 6}, full={"bandwidth": 64, "surfaces": 8})
def resolution(
    say: Say,
    bandwidth: int,
    surfaces: int,
    points: Sequence[int] = (3, 4, 6, 8, 12, 16, 32),
    parts: Sequence[str] = ("total", "plastic"),
) -> Charts:
    """Error of raw and corrected areas against points per wavelength and cost.

    The reference is the corrected area of the finest grid; no error below its own means anything.
    Raw areas are shares of grid points, extrapolated from two grids as 2 A(n) - A(n/2), because
    their error is of first order; the work counts both grids.
    """

    seeds, by = range(7, 7 + surfaces), ["part", "kind", "points_per_wavelength"]
    table = rows(say, area_errors, seed=seeds, points=[points], bandwidth=[bandwidth])
    work = table.groupby(by, sort=False)["work_points_transformed"].mean().reset_index()
    errors = root_mean_square(table, "relative_error", by).merge(work, on=by)
    worth = table[table["kind"] == REFERENCE].groupby("part")["relative_error"].mean()
    for part in parts:
        table = errors[errors["part"] == part].copy()
        table.loc[table["kind"] == REFERENCE, "relative_error"] = worth[part]
        caption = (
            f"Error of the {part} contact area of the capped body, root mean square over "
            f"{surfaces} surfaces, relative to the corrected area at {points[-1]} points per "
            f"shortest wavelength, which is uncertain by {worth[part]:.1e}"
        )
        plot = Plot(
            ("points_per_wavelength", "points per shortest wavelength (–)"),
            ("relative_error", f"relative error of the {part} area (–)"),
            series=("kind",),
            styles=_STYLES,
            log="xy",
            ticks=sorted(table["points_per_wavelength"].unique()),
            orders=KINDS,
        )
        yield plot, table, f"{caption}."
        work = ("work_points_transformed", "work: FFT pairs × grid points (–)")
        yield (
            replace(plot, x=work, ticks=(), orders=(), front=True),
            table[table["kind"].isin(KINDS)],
            f"{caption}; against the work of a solve: FFT pairs of all its grids, each times its "
            "points. Extrapolation pays for both of its grids.",
        )


def area_errors(seed: int, points: Sequence[int], bandwidth: int) -> list[dict[str, Any]]:
    """Errors of the areas of one surface against the corrected ones on the finest grid.

    Returns a row for each part, grid but the finest, and kind (KINDS, CLAIMED and REFERENCE): part,
    kind, points_per_wavelength, relative_error and work_points_transformed.
    """
    areas, work = {}, {}
    for n in points:
        scene = rough_scene(n, seed, bandwidth)
        result = bem.solve(scene, area_tolerance=1e-6)
        _, published = perimeter_areas(result.fields["pressure"], scene.material.hardness)
        areas[n] = dict(result.final.areas) | {"perimeter correction": published}
        work[n] = result.cost["equivalent_fft_pairs"] * result.cost["unknowns"]
    found = []
    for part, n in product(PARTS, points[:-1]):
        area = {kind: getattr(each, part) for kind, each in areas[n].items()}
        exact, uncertain = (getattr(areas[points[-1]][k], part) for k in ("corrected", "error"))
        halved = n % 2 == 0 and n // 2 in areas
        half = getattr(areas[n // 2]["raw"], part) if halved else math.nan
        area["raw, extrapolated"] = 2 * area["raw"] - half
        errors = {kind: area[kind] / exact - 1 for kind in KINDS}
        errors |= {CLAIMED: area["error"] / exact, REFERENCE: uncertain / exact}
        key = {"part": part, "points_per_wavelength": n}
        for kind, error in errors.items():
            # Extrapolation pays for both of its grids.
            spent = work[n] + (0.0 if kind != KINDS[1] else work[n // 2] if halved else math.nan)
            row = {"kind": kind, "relative_error": error, "work_points_transformed": spent}
            found.append(key | row)
    return found


#: How each method answers a scene on one thread.
_SOLVERS: dict[str, Callable[[Scene], Any]] = {
    "bem": lambda scene: bem.solve(scene, area_tolerance=1e-6, threads=1),
    "fem": lambda scene: fem_check.solve(scene, law="capped", certified=False),
}


def _theory(scene: Scene) -> float:
    """The theory's area, from the spectrum to the closed form."""
    slope = persson.roughness_of(scene.surface).rms_slope
    full = persson.full_contact_diffusion(effective_modulus(scene.material), slope**2)
    return float(persson.areas(GAMMA * full, scene.load.final, scene.material.hardness).total)


def _timed(solver: Callable[[Scene], Any], scene: Scene, repeats: int) -> tuple[Any, float]:
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        result = solver(scene)
        times.append(time.perf_counter() - started)
    return result, min(times)


@study("master", fast={"bandwidth": 16}, full={"bandwidth": 32})
def master(
    say: Say,
    bandwidth: int,
    finest: int = 64,
    grids: Mapping[str, Sequence[int]] = {"bem": (3, 4, 6, 8, 12, 16, 24), "fem": (3, 4, 6, 8)},
    seeds: Sequence[int] = range(7, 11),
) -> Charts:
    """Error of the contact area against time for all three methods on one scene.

    The scene is the paper's with a narrow band of roughness, so that finite elements can be
    refined, too; these have the same capped law on a block so deep that it matches the half-space
    within 1e-3.
    """
    references = {seed: _SOLVERS["bem"](rough_scene(finest, seed, bandwidth)) for seed in seeds}
    exact = {seed: area_of(result, "total") for seed, result in references.items()}
    claims = [area_of(r, "total", "error") / exact[seed] for seed, r in references.items()]

    def row(method: str, points_per_wavelength: int, seed: int) -> list[dict[str, Any]]:
        scene = rough_scene(points_per_wavelength, seed, bandwidth)
        result, seconds = _timed(_SOLVERS[method], scene, repeats=2)
        kinds = ("raw", "corrected")
        return [
            {"kind": kind, "seconds": seconds, "area": area_of(result, "total", kind)}
            for kind in kinds
        ]

    area, seconds = _timed(_theory, rough_scene(grids["bem"][0], seeds[0], bandwidth), repeats=20)
    by_theory = {"method": "persson", "kind": "", "seconds": seconds, "area": area}
    tables = [pd.DataFrame([by_theory | {"seed": seed} for seed in seeds])]
    for method, points in grids.items():
        _SOLVERS[method](rough_scene(points[0], seeds[0], bandwidth))  # compiled before timing
        tables.append(rows(say, row, method=[method], points_per_wavelength=points, seed=seeds))
    table = pd.concat(tables).fillna({"points_per_wavelength": 0})
    table["relative_error"] = table["area"] / table["seed"].map(exact) - 1
    by = ["method", "kind", "points_per_wavelength"]
    seconds = table.groupby(by, sort=False)["seconds"].mean().reset_index()
    errors = root_mean_square(table, "relative_error", by).merge(seconds, on=by)
    worth = sum(claims) / len(claims)
    ends = {"seconds": errors["seconds"].agg(["min", "max"]), "relative_error": worth}
    level = pd.DataFrame(ends | {"method": REFERENCE, "kind": ""})
    yield (
        Plot(
            ("seconds", "time of a solve on one thread (s)"),
            ("relative_error", "relative error of the contact area (–)"),
            series=("method", "kind"),
            styles=_STYLES,
            log="xy",
            front=True,
        ),
        pd.concat([errors, level]),
        "Error of the total contact area against time by theory, boundary and finite elements for "
        f"{len(seeds)} surfaces (root mean square, mean time) of the paper's roughness (in a "
        "narrower band), material and load, capped. Grid points per shortest wavelength rise from "
        f"left to right. Reference: bem, corrected, at {finest} points, bandwidth {bandwidth}, "
        f"uncertain by {worth:.1e} of itself. The theory knows only the spectrum, not the surface, "
        "so its error includes the scatter of surfaces. Times are the least of two on the machine "
        "that drew this.",
    )
