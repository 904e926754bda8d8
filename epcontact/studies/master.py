"""One scene, three methods: error of the contact area against time, with the Pareto front.

The scene is the paper's with a narrow band of roughness, so that finite elements can be refined
too, on a few surfaces, so that no error is small by chance.  Theory answers from the spectrum
alone, boundary and finite elements on finer and finer grids, with raw and with corrected areas;
the finite elements take the same capped law on a block so deep that the half-space is answered
within 1e-3.  The reference is the corrected area of the boundary elements on a grid finer than
any other; its claimed error is drawn.  Times are the least of two on one thread, in one run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.results import FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.results import ContactResult
    from epcontact.scene import Scene

Solver = Callable[["Scene"], "ContactResult"]
REPEATS = 2
UNCERTAINTY = "uncertainty of the reference"


@dataclass(frozen=True)
class Comparison:
    """Times in s, means over the surfaces, and relative errors of the total contact area, root
    mean squares over them, by series; and the mean reference.

    points: per shortest wavelength, by series; one 0 for the theory.
    """

    seconds: dict[str, FloatArray]
    errors: dict[str, FloatArray]
    points: dict[str, FloatArray]
    reference: float
    reference_error: float
    finest: int
    bandwidth: int
    surfaces: int


def measure(
    boundary: Sequence[int],
    finite: Sequence[int],
    finest: int,
    bandwidth: int,
    seeds: Sequence[int],
    progress: Progress,
) -> Comparison:
    """Solve surfaces on grids of so many points per shortest wavelength by each method.

    finest: of the reference, one a surface.
    """
    references = [_bem(scenes.rough_scene(finest, seed, bandwidth)) for seed in seeds]
    exact = np.array([scenes.area_of(one, "total") for one in references])
    claimed = np.array([scenes.area_of(one, "total", "error") for one in references])
    area, seconds = _theory(scenes.rough_scene(boundary[0], seeds[0], bandwidth))
    rows = {"persson": [(0.0, seconds, float(np.sqrt(np.mean((area / exact - 1) ** 2))))]}
    methods: list[tuple[str, Solver, Sequence[int]]] = [
        ("bem", _bem, boundary),
        ("fem", _fem, finite),
    ]
    for name, solver, grids in methods:
        solver(scenes.rough_scene(grids[0], seeds[0], bandwidth))  # compiled before timing
        for points in grids:
            progress(f"master: {name}, {points} points per wavelength")
            timed = [_timed(solver, scenes.rough_scene(points, s, bandwidth)) for s in seeds]
            seconds = float(np.mean([one for _, one in timed]))
            for kind in ("raw", "corrected"):
                areas = np.array([scenes.area_of(result, "total", kind) for result, _ in timed])
                error = float(np.sqrt(np.mean((areas / exact - 1) ** 2)))
                rows.setdefault(f"{name}, {kind}", []).append((points, seconds, error))
    table = {name: np.array(found).T for name, found in rows.items()}
    return Comparison(
        seconds={name: columns[1] for name, columns in table.items()},
        errors={name: columns[2] for name, columns in table.items()},
        points={name: columns[0] for name, columns in table.items()},
        reference=float(exact.mean()),
        reference_error=float((claimed / exact).mean()),
        finest=finest,
        bandwidth=bandwidth,
        surfaces=len(seeds),
    )


def _timed(solver: Solver, scene: Scene) -> tuple[ContactResult, float]:
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        result = solver(scene)
        times.append(time.perf_counter() - started)
    return result, min(times)


def _theory(scene: Scene) -> tuple[float, float]:
    """The theory's area, from the spectrum to equations (4) and (5), and its time in s."""
    from epcontact import persson
    from epcontact.moduli import effective_modulus

    times = []
    for _ in range(10 * REPEATS):
        started = time.perf_counter()
        slope = persson.roughness_of(scene.surface).rms_slope
        diffusion = scenes.GAMMA * persson.full_contact_diffusion(
            effective_modulus(scene.material), slope**2
        )
        found = persson.areas(diffusion, scene.load.final, scene.material.hardness)
        times.append(time.perf_counter() - started)
    return float(found.total), min(times)


def _bem(scene: Scene) -> ContactResult:
    from epcontact import bem

    return bem.solve(scene, area_tolerance=1e-6, threads=1)


def _fem(scene: Scene) -> ContactResult:
    import fem_check

    found: ContactResult = fem_check.solve(scene, law="capped", certified=False)
    return found


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """The one chart of all methods."""
    boundary = (3, 4, 6, 8, 12, 16, 24)
    bandwidth = 16 if size == "fast" else 32
    found = measure(boundary, boundary[:4], 64, bandwidth, range(7, 11), progress)
    return (draw_comparison(found),)


def draw_comparison(found: Comparison) -> Chart:
    """Error against time, the front, and what the reference is worth."""
    series = [Series(name, found.seconds[name], error) for name, error in found.errors.items()]
    ends = np.array(
        [min(map(np.min, found.seconds.values())), max(map(np.max, found.seconds.values()))]
    )
    told = "; ".join(
        f"{name} {100 * error.min():.2g} % in {found.seconds[name][int(error.argmin())]:.2g} s"
        for name, error in found.errors.items()
    )
    grids = ", ".join(f"{p:g}" for p in found.points["bem, raw"])
    blocks = ", ".join(f"{p:g}" for p in found.points["fem, raw"])
    return curves(
        [*series, Series(UNCERTAINTY, ends, np.full(2, found.reference_error), line=True)],
        x="time of a solve on one thread (s)",
        y="relative error of the contact area (–)",
        columns=("seconds", "relative_error"),
        caption="Error of the total contact area against time by theory, boundary and finite "
        f"elements for {found.surfaces} surfaces (root mean square, mean time) of the paper's "
        f"roughness, 1/{found.bandwidth} of its longest wave being the shortest, material and "
        "load, capped. Grid points per shortest wavelength: "
        f"{grids} (bem), {blocks} (fem). Reference: bem, corrected, at {found.finest} points, "
        f"{found.reference:.5f}, uncertain by {found.reference_error:.1e} of itself. The theory "
        "knows the spectrum alone, no surface, so that its error holds the scatter of surfaces. "
        f"Least errors: {told}. Times are the least of {REPEATS} on the machine that "
        "drew this.",
        log="xy",
        pareto=list(found.errors),
    )
