"""A scene answered by the theory: areas, distribution and separation at every mean pressure."""

from __future__ import annotations

import math
import time

from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.moduli import effective_modulus
from epcontact.persson.curves import (
    MagnificationCurve,
    PressureCurve,
    magnification_curve,
    pressure_curve,
)
from epcontact.persson.elastoplastic import areas, boundary_slopes, elastic_force
from epcontact.persson.reduction import EnergyReduction, Rule, reduced_diffusion
from epcontact.persson.roughness import SpectrumKind, roughness_of
from epcontact.persson.separation import SeparationModel, elastic_energy, mean_separation
from epcontact.results import Areas, ContactResult, LoadStep, PressureDistribution, Provenance
from epcontact.scene import Scene


def separation_model(
    scene: Scene,
    *,
    energy_reduction: float,
    spectrum: SpectrumKind = "analytic",
    reduction: Rule = "constant",
) -> SeparationModel:
    """What the theory reads of a scene, as `mean_separation` takes it; see `solve`.

    Raises InvalidScene.
    """
    if scene.body.kind != "half_space":
        raise InvalidScene(
            f"the body is a {scene.body.kind}, but the theory here is that of the half-space"
        )
    scene.require_loading()
    return SeparationModel(
        roughness=roughness_of(scene.surface, spectrum),
        effective_modulus=effective_modulus(scene.material),
        area_reduction=EnergyReduction(energy_reduction, reduction),
        hardness=scene.material.hardness,
    )


def solve(
    scene: Scene,
    *,
    energy_reduction: float,
    spectrum: SpectrumKind = "analytic",
    reduction: Rule = "constant",
    points: int = 1025,
) -> ContactResult:
    """Persson's theory for a scene on a half-space.

    energy_reduction: gamma; reduction: the rule it enters by (see `persson.reduction`).
    spectrum: "analytic", the one the surface was drawn from, or "surface", its own.
    points: pressures at which the distribution of the last load is tabulated.

    Raw and corrected areas are the same and exact: the theory has no grid.  Raises InvalidScene
    for a line, a layer, a surface without analytic spectrum where that is asked for, gamma
    outside (0, 1], or an unloading path of a body that flows.
    """
    started = time.perf_counter()
    model = separation_model(
        scene, energy_reduction=energy_reduction, spectrum=spectrum, reduction=reduction
    )
    diffusions = [_diffusion(model, p) for p in scene.load.path]
    steps = tuple(_step(model, p, G) for p, G in zip(scene.load.path, diffusions, strict=True))
    curve = pressure_curve(diffusions[-1], scene.load.final, model.hardness, points)
    options = {
        "energy_reduction": energy_reduction,
        "reduction": reduction,
        "spectrum": spectrum,
    }
    return ContactResult(
        method="persson",
        steps=steps,
        provenance=Provenance(scene.digest, scene.surface.seed, options),
        distribution=PressureDistribution(curve.pressure, curve.cumulative, curve.plastic),
        cost={"seconds": time.perf_counter() - started, "unknowns": 0},
        notes=(
            f"energy reduction gamma = {energy_reduction:g}, rule {reduction!r}, "
            f"{spectrum} spectrum",
            "the areas are those of the theory's equations, right to 1e-10 of themselves: there "
            "is no grid to correct for, and their error says nothing of the theory's own",
        ),
    )


def scene_magnification_curve(
    scene: Scene,
    magnifications: ArrayLike | None = None,
    *,
    energy_reduction: float,
    spectrum: SpectrumKind = "analytic",
    reduction: Rule = "constant",
) -> MagnificationCurve:
    """Areas against magnification at the scene's last load; see `magnification_curve`."""
    model = separation_model(
        scene, energy_reduction=energy_reduction, spectrum=spectrum, reduction=reduction
    )
    return magnification_curve(
        model.roughness,
        model.effective_modulus,
        model.area_reduction,
        scene.load.final,
        model.hardness,
        magnifications,
    )


def scene_pressure_curve(
    scene: Scene,
    magnification: float | None = None,
    *,
    energy_reduction: float,
    spectrum: SpectrumKind = "analytic",
    reduction: Rule = "constant",
) -> PressureCurve:
    """The pressure distribution at the scene's last load and one magnification (default: all)."""
    model = separation_model(
        scene, energy_reduction=energy_reduction, spectrum=spectrum, reduction=reduction
    )
    return pressure_curve(
        _diffusion(model, scene.load.final, magnification), scene.load.final, model.hardness
    )


def _diffusion(
    model: SeparationModel, mean_pressure: float, magnification: float | None = None
) -> float:
    """G of the whole roughness, or of that up to a magnification."""
    rough = model.roughness
    if magnification is None:
        variance = rough.rms_slope**2
    else:
        if not magnification >= 1:
            raise InvalidScene(f"magnification is {magnification!r}, but must be at least 1")
        variance = float(rough.slope_variance_up_to(magnification * rough.lowest))
    tau = model.effective_modulus**2 / 8 * variance
    return float(reduced_diffusion(model.area_reduction, tau, mean_pressure, model.hardness))


def _step(model: SeparationModel, mean_pressure: float, diffusion: float) -> LoadStep:
    hardness = model.hardness
    found = areas(diffusion, mean_pressure, hardness)
    exact = Areas(float(found.total), float(found.elastic), float(found.plastic))
    at_zero, at_hardness = boundary_slopes(diffusion, mean_pressure, hardness)
    elastic = float(elastic_force(diffusion, mean_pressure, hardness))
    plastic = hardness * exact.plastic if math.isfinite(hardness) else 0.0
    return LoadStep(
        mean_pressure=mean_pressure,
        areas={"raw": exact, "corrected": exact, "error": Areas(0.0, 0.0, 0.0)},
        residuals={
            "area": abs(exact.total + float(found.separated) - 1),
            "force": abs((elastic + plastic) / mean_pressure - 1),
        },
        quantities={
            "energy_reduction": model.area_reduction.gamma,
            "diffusion": diffusion,
            "rms_slope": model.roughness.rms_slope,
            "density_slope_at_zero": float(at_zero),
            "density_slope_at_hardness": float(at_hardness),
            "plastic_force_share": plastic / mean_pressure,
            "mean_gap": mean_separation(model, mean_pressure),
            "elastic_energy": elastic_energy(model, mean_pressure),
        },
    )
