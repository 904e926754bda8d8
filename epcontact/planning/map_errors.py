"""The errors that the measurement of a map causes, expected before the map is solved.

No grid makes these errors smaller.  The treatment of the edges has a known error.  The
removed plane and heights that nobody measured are solved for as a run solves for them:
as differences from other heights that agree with the map (`epcontact.alternatives`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from epcontact import bem
from epcontact.alternatives import TOLERANCE_OF_ERROR, on_coarser_grid
from epcontact.harness.case_files.case import Case
from epcontact.results import factor_to_95
from epcontact.scene import Load
from epcontact.surfaces import Recipe


@dataclass(frozen=True)
class MapErrors:
    """The expected errors of the area by the measurement of a map, and their cost.

    Attributes:
        parts: Half-width of the 95 % interval relative to the area, by the source of
            the error: "treatment" of the edges, "form" and "missing".
        solves: Number of solves that a run adds for "form" and "missing", for each load
            path.
        shape: Grid of these solves.
        work: FFT pairs times points of these solves for one load.
    """

    parts: dict[str, float]
    solves: int
    shape: tuple[int, ...]
    work: float


def expected_map_errors(
    case: Case, recipe: Recipe, step: int, threads: int | None = None
) -> MapErrors:
    """Return the errors of the area that the measurement of a map causes at a load.

    Args:
        case: The case.
        recipe: One of its surfaces; one that is not a map has no such errors.
        step: Number of the load in the path.
        threads: Number of threads; None: all cores.

    Raises:
        NotConverged: A solve does not converge.
    """
    scene = case.scene(recipe)
    surface = scene.surface
    parts = {}
    if surface.treatment_errors:
        error = surface.treatment_errors["total_area"]
        parts["treatment"] = error * factor_to_95("treatment")
    if not surface.alternatives:
        return MapErrors(parts, 0, surface.shape, 0.0)
    path = scene.load.path
    last = range(len(path))[step]
    compared = on_coarser_grid(replace(scene, load=Load(path[: last + 1])))
    result = bem.solve(compared, area_tolerance=TOLERANCE_OF_ERROR, threads=threads)
    area = result.final.best_areas.total
    for source, error in result.final.error_parts("total_area").items():
        if source in ("form", "missing") and area:
            parts[source] = error / area
    solves = len(surface.alternatives)
    if compared.surface is not surface:
        solves += 1  # of the map itself on the coarser grid
    points = result.cost["unknowns"]
    pairs = result.cost["equivalent_fft_pairs"] / (last + 1)
    return MapErrors(parts, solves, compared.surface.shape, solves * pairs * points)
