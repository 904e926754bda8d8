"""Solve a scene by the theory: areas, distribution and separation at every mean
pressure.
"""

from __future__ import annotations

import math
import time

from epcontact.persson.elastoplastic import areas, boundary_slopes, elastic_force
from epcontact.persson.reduction import Rule
from epcontact.persson.roughness import SpectrumKind
from epcontact.persson.separation import elastic_energy, mean_separation
from epcontact.persson.theory import Theory, pressure_curve
from epcontact.persson.validity import expectation
from epcontact.results import (
    Areas,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)
from epcontact.scene import Scene, Surface


def solve(
    scene: Scene,
    *,
    energy_reduction: float,
    spectrum: SpectrumKind = "analytic",
    reduction: Rule = "constant",
    points: int = 1025,
) -> ContactResult:
    """Persson's theory for a scene on a half-space.

    Raw and corrected areas are the same and exact: the theory has no grid.  The rule
    "local" is solved on one, to 1e-3, and has no diffusion, gap or elastic energy.

    Args:
        scene: An isotropic surface on a half-space under non-decreasing loads.
        energy_reduction, spectrum, reduction: See `Theory.of_scene`.
        points: Number of pressures at which the distribution of the last load is
            tabulated.

    Raises:
        InvalidScene: The scene is a line, a layer or an unloading path, or has no
            analytic spectrum; or gamma is out of range.

    Example:
        >>> from epcontact import Load, Material, Scene, SelfAffineSpectrum
        >>> from epcontact.surfaces import SelfAffine
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, rms_slope=1.0)
        >>> surface = SelfAffine(spectrum, (6.2832e-5, 6.2832e-5), (64, 64), seed=7).build()
        >>> scene = Scene(surface, Material(250e9, 0.0, hardness=150e9), Load(12.5e9))
        >>> print(f"{solve(scene, energy_reduction=0.536).final.areas['corrected'].total:.4f}")
        0.1097
    """
    started = time.perf_counter()
    theory = Theory.of_scene(
        scene, energy_reduction=energy_reduction, spectrum=spectrum, reduction=reduction
    )
    steps = tuple(_step(theory, p, scene.surface) for p in scene.load.path)
    local = reduction == "local"
    if local:
        curve = theory.pressure_curve(scene.load.final)
    else:
        diffusion = steps[-1].quantities["diffusion"]
        curve = pressure_curve(diffusion, scene.load.final, theory.hardness, points)
    gamma = theory.reduction.gamma
    options = {"energy_reduction": gamma, "reduction": reduction, "spectrum": spectrum}
    return ContactResult(
        method="persson",
        steps=steps,
        provenance=Provenance(scene.digest, scene.surface.seed, options),
        distribution=PressureDistribution(
            curve.pressure, curve.cumulative, curve.plastic
        ),
        cost={"seconds": time.perf_counter() - started, "unknowns": 0},
        notes=(
            *scene.surface.notes,
            f"energy reduction gamma = {gamma:g}, rule {reduction!r}, {spectrum} spectrum",
            "the areas solve the theory's equations to a relative error of "
            f"{'1e-3' if local else '1e-10'}, without a grid to correct for",
            expectation(theory, scene.load.final),
        ),
    )


def _step(theory: Theory, mean_pressure: float, surface: Surface) -> LoadStep:
    hardness, more = theory.hardness, {}
    if theory.reduction.rule == "local":
        state = theory.local_state(mean_pressure)
        shares, elastic = state.areas, state.force
        at_zero, at_hardness = state.slopes
    else:
        diffusion = float(theory.diffusion(mean_pressure))
        shares = areas(diffusion, mean_pressure, hardness)
        at_zero, at_hardness = map(
            float, boundary_slopes(diffusion, mean_pressure, hardness)
        )
        elastic = float(elastic_force(diffusion, mean_pressure, hardness))
        more = {
            "diffusion": diffusion,
            "mean_gap": mean_separation(theory, mean_pressure),
            "elastic_energy": elastic_energy(theory, mean_pressure),
        }
    exact = Areas(float(shares.total), float(shares.elastic), float(shares.plastic))
    plastic = hardness * exact.plastic if math.isfinite(hardness) else 0.0
    step = LoadStep(
        mean_pressure=mean_pressure,
        areas={"raw": exact, "corrected": exact, "error": Areas(0.0, 0.0, 0.0)},
        residuals={
            "area": abs(exact.total + float(shares.separated) - 1),
            "force": abs((elastic + plastic) / mean_pressure - 1),
        },
        quantities={
            "energy_reduction": theory.reduction.gamma,
            "rms_slope": theory.roughness.rms_slope,
            "density_slope_at_zero": at_zero,
            "density_slope_at_hardness": at_hardness,
            "plastic_force_share": plastic / mean_pressure,
            **more,
        },
    )
    return step.with_errors(surface.treatment_errors, "treatment")
