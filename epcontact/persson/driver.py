"""Solve a scene by the theory: areas, pressures and separation at each load."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from epcontact.alternatives import with_measurement_errors
from epcontact.persson.clipped_pressure import displacements
from epcontact.persson.elastoplastic import (
    ContactAreas,
    areas,
    boundary_slopes,
    elastic_force,
)
from epcontact.persson.near_bounds import StressState
from epcontact.persson.reduction import Rule
from epcontact.persson.roughness import SpectrumKind
from epcontact.persson.separation import elastic_energy, mean_separation
from epcontact.persson.theory import PressureCurve, Theory, pressure_curve
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
    progress: Callable[[float, str], None] | None = None,
) -> ContactResult:
    """Solve a scene on a half-space by Persson's theory.

    Raw and corrected areas are the same and exact, because the theory has no grid.  The
    rule "near_bounds" is solved on a grid, to 3e-3.  It has no diffusion, and its gap,
    plastic displacement and energy are those of `persson.clipped_pressure`.

    Args:
        scene: An isotropic surface on a half-space under non-decreasing loads.
        energy_reduction: gamma, between 0 (excluded) and 1.
        spectrum: "analytic" for the spectrum that the surface was drawn from, "surface"
            for the spectrum of the surface's heights.
        reduction: The rule by which gamma enters, see `persson.reduction`.
        points: Number of pressures at which the distribution of the last load is
            tabulated.
        progress: Called after each load but the last with the fraction of the path that
            is done, from 0 to 1, and a text; None: nothing is called.

    Raises:
        InvalidScene: The scene is a line, a layer or an unloading path, or has no
            analytic spectrum; or gamma is out of range.

    Example:
        >>> from epcontact import Load, Material, Scene, SelfAffineSpectrum
        >>> from epcontact.surfaces import SelfAffine
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 2e5, 16e5, rms_slope=1.0)
        >>> periods = (6.2832e-5, 6.2832e-5)
        >>> surface = SelfAffine(spectrum, periods, (64, 64), seed=7).build()
        >>> scene = Scene(surface, Material(250e9, 0.0, hardness=150e9), Load(12.5e9))
        >>> result = solve(scene, energy_reduction=0.536)
        >>> print(f"{result.final.areas['corrected'].total:.4f}")
        0.1097
    """
    started = time.perf_counter()
    theory = Theory.of_scene(
        scene, energy_reduction=energy_reduction, spectrum=spectrum, reduction=reduction
    )
    steps = []
    for mean_pressure in scene.load.path:
        state = _stress_state(theory, mean_pressure)
        steps.append(_load_step(theory, mean_pressure, scene.surface, state))
        if progress is not None and len(steps) < len(scene.load.path):
            fraction = len(steps) / len(scene.load.path)
            progress(fraction, f"load {len(steps)} of {len(scene.load.path)}")
    if spectrum == "surface":

        def solve_alternative(changed: Scene) -> list[LoadStep]:
            """Return the theory's steps for a surface with other heights."""
            other = Theory.of_scene(
                changed,
                energy_reduction=energy_reduction,
                spectrum=spectrum,
                reduction=reduction,
            )
            found = []
            for load in changed.load.path:
                at_load = _stress_state(other, load)
                found.append(_load_step(other, load, changed.surface, at_load))
            return found

        steps = list(with_measurement_errors(scene, steps, solve_alternative))
    if state is not None:
        curve = PressureCurve.of_state(state)
        contact = state.areas
        accuracy = "3e-3"
    else:
        contact = None
        diffusion = steps[-1].quantities["diffusion"]
        curve = pressure_curve(diffusion, scene.load.final, theory.hardness, points)
        accuracy = "1e-10"
    expected = expectation(theory, scene.load.final, contact, scene.surface)
    gamma = theory.reduction.gamma
    options = {"energy_reduction": gamma, "reduction": reduction, "spectrum": spectrum}
    notes = (
        f"energy reduction gamma = {gamma:g}, rule {reduction!r}, {spectrum} spectrum",
        "the areas solve the theory's equations to a relative error of "
        f"{accuracy}, without a grid to correct for",
        expected,
    )
    return ContactResult(
        method="persson",
        steps=tuple(steps),
        provenance=Provenance(scene.digest, scene.surface.seed, options),
        distribution=PressureDistribution(
            curve.pressure, curve.cumulative, curve.plastic
        ),
        cost={"seconds": time.perf_counter() - started, "unknowns": 0},
        notes=(*scene.surface.notes, *notes),
    )


def _stress_state(theory: Theory, mean_pressure: float) -> StressState | None:
    """Return the stress by the rule "near_bounds"; None for the other rules.

    Args:
        theory: The theory of the scene's body.
        mean_pressure: In Pa.
    """
    if theory.reduction.rule == "near_bounds":
        return theory.stress_state(mean_pressure)
    return None


def _load_step(
    theory: Theory, mean_pressure: float, surface: Surface, state: StressState | None
) -> LoadStep:
    """Return areas, residuals and quantities of the theory at one load.

    Args:
        theory: The theory of the scene's body.
        mean_pressure: In Pa.
        surface: The scene's surface, whose treatment (such as filters) has error
            estimates that are added to the step.
        state: The stress by the rule "near_bounds"; None: the rule is another.
    """
    hardness = theory.hardness
    quantities = {
        "energy_reduction": theory.reduction.gamma,
        "rms_slope": theory.roughness.rms_slope,
    }
    contact: ContactAreas
    if state is not None:
        contact = state.areas
        elastic_load = state.force
        at_zero, at_hardness = state.slopes
        moved = displacements(theory, mean_pressure)
        of_rule = {
            "mean_gap": moved.mean_gap,
            "mean_separation": moved.mean_gap - moved.plastic_displacement,
            "mean_plastic_displacement": moved.plastic_displacement,
            "elastic_energy": moved.elastic_energy,
        }
    else:
        G = float(theory.diffusion(mean_pressure))
        contact = areas(G, mean_pressure, hardness)
        elastic_load = float(elastic_force(G, mean_pressure, hardness))
        slopes = boundary_slopes(G, mean_pressure, hardness)
        at_zero, at_hardness = float(slopes[0]), float(slopes[1])
        of_rule = {
            "diffusion": G,
            "mean_gap": mean_separation(theory, mean_pressure),
            "elastic_energy": elastic_energy(theory, mean_pressure),
        }
    exact = Areas(float(contact.total), float(contact.elastic), float(contact.plastic))
    plastic_load = hardness * exact.plastic if math.isfinite(hardness) else 0.0
    quantities["density_slope_at_zero"] = at_zero
    quantities["density_slope_at_hardness"] = at_hardness
    quantities["plastic_force_share"] = plastic_load / mean_pressure
    step = LoadStep(
        mean_pressure=mean_pressure,
        areas={"raw": exact, "corrected": exact, "error": Areas(0.0, 0.0, 0.0)},
        residuals={
            "area": abs(exact.total + float(contact.separated) - 1),
            "force": abs((elastic_load + plastic_load) / mean_pressure - 1),
        },
        quantities=quantities | of_rule,
    )
    return step.with_errors(surface.treatment_errors, "treatment")
