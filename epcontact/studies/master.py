"""One scene, three methods: error of the contact area against time, with the Pareto front.

The scene is the paper's with a narrow band of roughness, so that finite elements can be refined,
too.  Several surfaces keep an error from being small by chance.  The theory uses the spectrum
alone; boundary and finite elements use ever finer grids, with raw and with corrected areas.  The
finite elements have the same capped law on a block so deep that it matches the half-space within
1e-3.  The reference is the corrected area of the boundary elements on a grid finer than
any other; its claimed error is drawn.  Times are the least of two on one thread, in one run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import pandas as pd

import fem_check
from epcontact import bem, persson
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.studies.paper_scene import GAMMA, area_of, rough_scene
from epcontact.studies.tables import Progress, Size, listed, root_mean_square

REPEATS = 2
UNCERTAINTY = "uncertainty of the reference"


def solved_areas(
    grids: Mapping[str, Sequence[int]],
    finest: int,
    bandwidth: int,
    seeds: Sequence[int],
    progress: Progress,
) -> pd.DataFrame:
    """Solve surfaces on grids of so many points per shortest wavelength by each method.

    Args:
        grids: points per shortest wavelength by method, "bem" or "fem".
        finest: those of the reference, one a surface.
        bandwidth: highest over lowest wave number.
        seeds: one surface each.
        progress: called with a sentence before each grid.

    Returns:
        One row for each surface, method, kind of area and grid: method ("persson", "bem", "fem"),
        kind ("raw", "corrected"; empty of the theory), points_per_wavelength, seed, seconds,
        area_fraction, and reference and reference_error (relative) of the surface.
    """
    references = {seed: _bem(rough_scene(finest, seed, bandwidth)) for seed in seeds}
    solvers = {"bem": _bem, "fem": _fem}
    area, seconds = _theory(rough_scene(grids["bem"][0], seeds[0], bandwidth))
    rows = [("persson", "", 0, seed, seconds, area) for seed in seeds]
    for method, points in grids.items():
        solvers[method](rough_scene(points[0], seeds[0], bandwidth))  # compiled before timing
        for n in points:
            progress(f"master: {method}, {n} points per wavelength")
            for seed in seeds:
                result, seconds = _timed(solvers[method], rough_scene(n, seed, bandwidth))
                for kind in ("raw", "corrected"):
                    rows.append((method, kind, n, seed, seconds, area_of(result, "total", kind)))
    names = ["method", "kind", "points_per_wavelength", "seed", "seconds", "area_fraction"]
    table = pd.DataFrame(rows, columns=names)
    exact = {seed: area_of(result, "total") for seed, result in references.items()}
    claimed = {s: area_of(r, "total", "error") / exact[s] for s, r in references.items()}
    return table.assign(
        reference=table["seed"].map(exact), reference_error=table["seed"].map(claimed)
    )


def area_errors(solved: pd.DataFrame) -> pd.DataFrame:
    """Return errors and times of `solved_areas`, one row for each method, kind and grid.

    relative_error is the root mean square over the surfaces, seconds their mean.
    """
    by = ["method", "kind", "points_per_wavelength"]
    table = solved.assign(relative_error=solved["area_fraction"] / solved["reference"] - 1)
    seconds = table.groupby(by, sort=False)["seconds"].mean().reset_index()
    return root_mean_square(table, "relative_error", by).merge(seconds, on=by)


def _timed(solver: Callable[[Scene], ContactResult], scene: Scene) -> tuple[ContactResult, float]:
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        result = solver(scene)
        times.append(time.perf_counter() - started)
    return result, min(times)


def _theory(scene: Scene) -> tuple[float, float]:
    """The theory's area, from the spectrum to the closed form, and its time in s."""
    times = []
    for _ in range(10 * REPEATS):
        started = time.perf_counter()
        slope = persson.roughness_of(scene.surface).rms_slope
        full = persson.full_contact_diffusion(effective_modulus(scene.material), slope**2)
        areas = persson.areas(GAMMA * full, scene.load.final, scene.material.hardness)
        times.append(time.perf_counter() - started)
    return float(areas.total), min(times)


def _bem(scene: Scene) -> ContactResult:
    return bem.solve(scene, area_tolerance=1e-6, threads=1)


def _fem(scene: Scene) -> ContactResult:
    result: ContactResult = fem_check.solve(scene, law="capped", certified=False)
    return result


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """The one chart of all methods."""
    grids = {"bem": (3, 4, 6, 8, 12, 16, 24), "fem": (3, 4, 6, 8)}
    bandwidth = 16 if size == "fast" else 32
    solved = solved_areas(grids, 64, bandwidth, range(7, 11), progress)
    return (draw_methods(solved, f"bem, corrected, at 64 points, bandwidth {bandwidth}"),)


def draw_methods(solved: pd.DataFrame, reference: str) -> Chart:
    """Draw error against time, the Pareto front and the uncertainty of the reference.

    Args:
        solved: the table of `solved_areas`.
        reference: its name in the caption.
    """
    errors = area_errors(solved)
    surfaces = solved.drop_duplicates("seed")
    worth = surfaces["reference_error"].mean()
    ends = {"seconds": errors["seconds"].agg(["min", "max"]), "relative_error": worth}
    level = pd.DataFrame(ends | {"method": UNCERTAINTY, "kind": "", "style": "curve"})
    least = errors.loc[errors.groupby(["method", "kind"], sort=False)["relative_error"].idxmin()]
    least = least.assign(percent=100 * least["relative_error"])
    return draw_table(
        pd.concat([errors, level]),
        Plot(
            ("seconds", "time of a solve on one thread (s)"),
            ("relative_error", "relative error of the contact area (–)"),
            series=("method", "kind"),
            log="xy",
            front=True,
        ),
        "Error of the total contact area against time by theory, boundary and finite elements for "
        f"{len(surfaces)} surfaces (root mean square, mean time) of the paper's roughness (in a "
        "narrower band), material and load, capped. Grid points per shortest wavelength rise from "
        f"left to right. Reference: {reference}, {surfaces['reference'].mean():.5f}, uncertain by "
        f"{worth:.1e} of itself. The theory knows only the spectrum, not the surface, so its "
        "error includes the scatter of surfaces. Least errors: "
        f"{listed(least, '{method} {kind} {percent:.2g} % in {seconds:.2g} s')}. Times are the "
        f"least of {REPEATS} on the machine that drew this.",
    )
