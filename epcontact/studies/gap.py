"""The mean gap against the mean pressure: its elastic and its plastic part, beside theory and FE.

Of the gap g between the flat and the elastically deformed surface, negative where the flat stands
below it because the surface has flowed:

    open gap              <max(g, 0)>   what is left open between the surfaces
    plastic displacement  <max(-g, 0)>  by how much flow has lowered the surface
    separation            <g> = open gap - plastic displacement, the distance of the flat from
                          the mean plane of the elastically deformed surface

all means over the nominal area.  As the pressure p rises, its work on the separation is stored or
spent on flow, -p d<g> = dU_el + sigma_P d<max(-g, 0)>, so that the share of the work that is
plastic is sigma_P w/(U_el + sigma_P w) with the plastic displacement w.  The theory's mean
separation is the open gap, that of the surface as the flow has left it (`persson.separation`).

Finite elements answer one small scene by the same laws on the same grid, and by J2 flow, whose
displacement of the surface holds the plastic one: there the gap is nowhere negative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from epcontact.results import FloatArray
from epcontact.scene import Load
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.results import ContactResult
    from epcontact.scene import Scene


LAWS = {"capped": scenes.HARDNESS, "elastic": math.inf}
#: Mean pressures over E*, in units of which the hardness is 0.6; the paper has 0.05.
LOADS = tuple(0.00625 * 2.0**k for k in range(7))
#: Of the theory's curve, to each of LOADS.
STEPS = 4
#: J2 carries the last of LOADS on all of the surface.
BLOCK_LOADS = LOADS[:-1]
#: Hardness over yield stress, as in the paper.
CONSTRAINT = 3.0
OPEN, SEPARATION, PLASTIC = "mean_gap", "mean_separation", "mean_plastic_displacement"
NAMES = {OPEN: "open gap", SEPARATION: "separation", PLASTIC: "plastic displacement"}


@dataclass(frozen=True)
class Gaps:
    """Lengths over the rms height, by law.

    loads: (m,) mean pressures over E*.  found: (surfaces, m) by quantity; theory: open gap at
    `curve_loads`, (STEPS (m - 1) + 1,), of which each STEPS-th is one of the loads.
    plastic_share: (m,) of the load's work, capped, mean over the surfaces.  grid_error: largest
    relative change of the open gap of the first surface on a grid twice as fine.
    """

    loads: FloatArray
    found: dict[str, dict[str, FloatArray]]
    curve_loads: FloatArray
    theory: dict[str, FloatArray]
    plastic_share: FloatArray
    grid_error: dict[str, float]
    points: float
    bandwidth: int

    def deviation(self, law: str) -> tuple[FloatArray, FloatArray]:
        """The theory's open gap over that of boundary elements, less 1: mean over the surfaces
        and half the 95 % interval, (m,) each."""
        ratios = self.theory[law][::STEPS] / self.found[law][OPEN] - 1
        mean, width = np.array([scenes.mean_and_half_width(column) for column in ratios.T]).T
        return mean, width


@dataclass(frozen=True)
class Blocks:
    """Open gaps over the rms height on one small scene, (m,) each, by solver ("bem" or "fem"),
    law and points per shortest wavelength."""

    loads: FloatArray
    gaps: dict[tuple[str, str, int], FloatArray]
    bandwidth: int

    @property
    def finest(self) -> int:
        """The most points per shortest wavelength."""
        return max(points for _, _, points in self.gaps)

    def deviation(self, law: str, points: int) -> FloatArray:
        """Finite over boundary elements of the same grid, less 1; J2 over the capped law."""
        own = "capped" if law == "j2" else law
        return self.gaps["fem", law, points] / self.gaps["bem", own, points] - 1


def measure(points: int, bandwidth: int, seeds: Sequence[int], progress: Progress) -> Gaps:
    """Solve surfaces along LOADS by boundary elements and theory, capped and elastic."""
    from epcontact import bem, persson

    found: dict[str, dict[str, FloatArray]] = {}
    theory, grid_error, shares = {}, {}, []
    curve_loads = np.geomspace(LOADS[0], LOADS[-1], STEPS * (len(LOADS) - 1) + 1)
    for law, hardness in LAWS.items():
        results = []
        for seed in seeds:
            progress(f"gap: {law}, seed {seed}")
            scene = _loaded(scenes.rough_scene(points, seed, bandwidth, hardness), LOADS)
            results.append(replace(bem.solve(scene, area_tolerance=1e-5), fields={}))
        scale = float(scene.surface.heights.std())
        found[law] = {key: np.stack([_along(r, key) for r in results]) / scale for key in NAMES}
        path = _loaded(scene, curve_loads.tolist())
        solved = persson.solve(path, energy_reduction=scenes.GAMMA, spectrum="surface")
        theory[law] = _along(solved, OPEN) / scale
        fine = _loaded(scenes.rough_scene(2 * points, seeds[0], bandwidth, hardness), LOADS)
        finer = _along(bem.solve(fine, area_tolerance=1e-5), OPEN)
        change = finer / fine.surface.heights.std() / found[law][OPEN][0] - 1
        grid_error[law] = float(np.abs(change).max())
        if math.isfinite(hardness):
            shares = [plastic_share(r, hardness) for r in results]
    share = np.mean(shares, axis=0)
    return Gaps(np.array(LOADS), found, curve_loads, theory, share, grid_error, points, bandwidth)


def plastic_share(result: ContactResult, hardness: float) -> FloatArray:
    """(m,): the share of the load's work that was spent on flow, at each load step."""
    spent, stored = hardness * _along(result, PLASTIC), _along(result, "elastic_energy")
    return spent / (stored + spent)


def measure_blocks(points: Sequence[int], bandwidth: int, seed: int, progress: Progress) -> Blocks:
    """Solve one surface along BLOCK_LOADS by boundary and finite elements, on several grids."""
    import fem_check
    from epcontact import bem

    gaps = {}
    for n in points:
        for law, hardness in LAWS.items():
            progress(f"gap: finite elements, {n} points per wavelength, {law}")
            scene = _loaded(scenes.rough_scene(n, seed, bandwidth, hardness), BLOCK_LOADS)
            scale = float(scene.surface.heights.std())
            gaps["bem", law, n] = _along(bem.solve(scene), OPEN) / scale
            fem = fem_check.solve(scene, law=law, certified=False)  # type: ignore[arg-type]
            gaps["fem", law, n] = _along(fem, OPEN) / scale
        progress(f"gap: finite elements, {n} points per wavelength, j2")
        flowing = replace(scene.material, yield_stress=scenes.HARDNESS / CONSTRAINT)
        fem = fem_check.solve(replace(scene, material=flowing), law="j2", certified=False)
        gaps["fem", "j2", n] = _along(fem, OPEN) / scale
    return Blocks(np.array(BLOCK_LOADS), gaps, bandwidth)


def _loaded(scene: Scene, loads: Sequence[float]) -> Scene:
    return replace(scene, load=Load(tuple(scenes.MODULUS * load for load in loads)))


def _along(result: ContactResult, quantity: str) -> FloatArray:
    """(m,): a quantity at each load step."""
    return np.array([step.quantities[quantity] for step in result.steps])


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Open gaps, their parts, the theory's deviation; the same of finite elements."""
    from epcontact.studies.gap_charts import draw_blocks, draw_gaps

    points, bandwidth, seeds, grids = (
        (4, 64, range(7, 11), (3, 6)) if size == "fast" else (8, 128, range(7, 15), (4, 8))
    )
    gaps = measure(points, bandwidth, seeds, progress)
    return (*draw_gaps(gaps), *draw_blocks(measure_blocks(grids, 8, 7, progress)))
