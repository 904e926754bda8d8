"""The reasons why finite and boundary elements differ on a scene, each measured separately.

A comparison of the two is a chain of solves in which one thing changes at a time:

    finite elements, law ---- boundary elements on the elements' own surface compliance
        solver          same law, same discrete body: the difference is rounding alone
    ---- boundary elements on the exact layer of the elements' depth
        discretisation  same law, same depth: the elements against the exact kernel
    ---- boundary elements on the scene's own body
        depth           same law, both by boundary elements: the depth alone

and, where the finite elements flow by J2, before all of these,

    finite elements, j2 ---- boundary elements capped at the hardness, on the elements' compliance
        model           plastic flow against a pressure cap: physics, not error.

`measured_hardness` (module `model_difference`) turns the model part into a number: the cap, in
units of the yield stress, at which the capped body has the contact area of the J2 body under the
same load.  `crosscheck` reports these for each surface of a case and for their ensemble.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates.distances import Difference, difference
from epcontact.harness.gates.statistics import estimate, standard_deviation
from epcontact.harness.quantities.model_difference import (
    EffectiveHardness,
    combined,
    measured_hardness,
    path_options,
)
from epcontact.results import ContactResult
from epcontact.scene import Body, Scene
from epcontact.surfaces import SelfAffine

__all__ = [
    "Difference",
    "EffectiveHardness",
    "ErrorBudget",
    "crosscheck",
    "difference",
    "error_budget",
    "measured_hardness",
]


@dataclass(frozen=True)
class ErrorBudget:
    """The parts of a difference along the chain; `model` is None unless the law is j2."""

    law: str
    model: Difference | None
    solver: Difference
    discretisation: Difference
    depth: Difference

    def __str__(self) -> str:
        parts = [] if self.model is None else [f"model: {self.model}"]
        parts.append(f"solver: {self.solver} ({self.solver.nodes} nodes)")
        parts.append(f"discretisation: {self.discretisation}")
        parts.append(f"depth: {self.depth}")
        return f"fem {self.law} against bem: " + "; ".join(parts)


def error_budget(
    scene: Scene,
    *,
    law: Literal["elastic", "capped", "j2"] = "capped",
    depth: float | None = None,
    layers: int | None = None,
    steps: int | None = None,
    step_tolerance: float | None = None,
    report: Callable[[str], None] | None = print,
) -> ErrorBudget:
    """Split the difference between finite and boundary elements on a scene into its parts.

    Args:
        scene: a scene with a single mean pressure.
        law: the law of the finite elements.  After j2 the chain continues with the capped law if
            the scene has a hardness, otherwise with the elastic law.
        depth: depth of the element block in m; None: chosen from the scene.
        layers: number of element layers; None: chosen from the scene.
        steps, step_tolerance: of a J2 load path, as for `fem_check.solve`.
        report: called with the budget in one line.

    Raises:
        InvalidScene: for a path of loads, and for what the two solvers refuse.
        NotConverged: if a solver does not converge.
    """
    path = path_options(steps, step_tolerance)
    budget, _ = _budget(scene, law, {"depth": depth, "layers": layers}, path)
    if report is not None:
        report(str(budget))
    return budget


def _budget(
    scene: Scene, law: str, block: dict[str, Any], path: dict[str, Any]
) -> tuple[ErrorBudget, ContactResult | None]:
    """Return the parts, and the J2 answer if the law is j2."""
    if len(scene.load.path) != 1:
        raise InvalidScene(
            f"the scene has a path of {len(scene.load.path)} mean pressures; give a single one"
        )
    hardness = scene.material.hardness
    if law == "elastic":
        hardness = math.inf
    capped = replace(scene, material=replace(scene.material, hardness=hardness))
    linear_law: Literal["capped", "elastic"] = "capped" if math.isfinite(hardness) else "elastic"
    fem = fem_check.solve(capped, law=linear_law, **block)
    own = bem.solve(capped, compliance=fem_check.surface_compliance(scene, **block))
    body = scene.body
    if body.kind == "half_space":
        body = Body("bonded_layer", float(fem.provenance.options["depth"]))
    layer = bem.solve(replace(capped, body=body))
    whole = layer if body == scene.body else bem.solve(capped)
    j2 = fem_check.solve(scene, law="j2", **block, **path) if law == "j2" else None
    budget = ErrorBudget(
        law,
        None if j2 is None else difference(j2, own, hardness),
        difference(fem, own, hardness),
        difference(own, layer, hardness),
        difference(layer, whole, hardness),
    )
    return budget, j2


@dataclass(frozen=True)
class Checked:
    """The measurements on one surface.

    `effective` and `largest` (the largest pressure over sigma_Y) exist only if the law is j2;
    `halved` is True if the error of the effective hardness includes the effect of the grid.
    """

    budget: ErrorBudget
    halved: bool
    effective: EffectiveHardness | None = None
    largest: float = math.nan


def crosscheck(
    case: Case,
    seeds: Sequence[int] = (),
    *,
    steps: int | None = None,
    step_tolerance: float | None = None,
) -> str:
    """Report why the finite and the boundary elements of a case differ, surface by surface.

    The report holds the error budget of the case's finite-element law; for j2 also both contact
    areas, their overlap, the distance of the pressure distributions, and the effective hardness;
    for several surfaces their means with standard errors.

    Args:
        case: a case with the methods fem and bem.
        seeds: seeds of random surfaces by the case's recipe, which replace the case's own.
        steps, step_tolerance: of the J2 load path, in the place of the case's own.

    Returns:
        The report, as several lines of text.

    Raises:
        InvalidCase: if the case has nothing to cross-check.
        InvalidScene, NotConverged: as the solvers do.
    """
    _require_checkable(case)
    given = path_options(steps, step_tolerance)
    if given and case.options["fem"]["law"] != "j2":
        raise InvalidCase(f"{case.path}: {min(given)} is for fem.law = 'j2' only")
    recipes = case.recipes if not seeds else _other_surfaces(case, seeds)
    options = dict(case.options["fem"])
    if given:
        options |= {"steps": None} | given
    lines, checks = [], []
    for recipe in recipes:
        seed = getattr(recipe, "seed", None)
        lines.append(f"{case.id}, {case.size}" + ("" if seed is None else f", seed {seed}"))
        checks.append(_checked(case.scene(recipe), options))
        lines += [f"  {line}" for line in _surface_lines(checks[-1], case.material.hardness)]
    if len(checks) > 1:
        lines.append(
            f"{case.id}, {case.size}, {len(checks)} surfaces: mean +- standard error "
            "(standard deviation of a surface)"
        )
        lines += [f"  {line}" for line in _ensemble_lines(checks)]
    return "\n".join(lines)


def _other_surfaces(case: Case, seeds: Sequence[int]) -> list[SelfAffine]:
    first = case.recipes[0]
    if not isinstance(first, SelfAffine):
        raise InvalidCase(f"{case.path}: its surface is not random, so it has no seeds")
    if len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise InvalidCase(f"seeds are {list(seeds)}, but must be different numbers from 0 on")
    return [replace(first, seed=seed) for seed in seeds]


def _require_checkable(case: Case) -> None:
    if case.skip:
        raise InvalidCase(f"{case.path}: {case.skip}")
    missing = [m for m in ("fem", "bem") if m not in case.methods]
    if missing:
        raise InvalidCase(
            f"{case.path}: case.methods lacks {' and '.join(missing)}; a cross-check needs both "
            "fem and bem"
        )
    if len(case.load.path) != 1:
        raise InvalidCase(
            f"{case.path}: load.mean_pressure is a path of {len(case.load.path)}, but a "
            "cross-check answers a single mean pressure"
        )
    options = case.options["fem"]
    if options["geometry"] != "gap":
        raise InvalidCase(
            f"{case.path}: fem.geometry is {options['geometry']!r}, but must be 'gap': the "
            "boundary elements have no other, so slope and error could not be separated"
        )


def _checked(scene: Scene, options: Mapping[str, Any]) -> Checked:
    block = {name: options.get(name) for name in ("depth", "layers")}
    steps = options.get("steps")
    path = path_options(steps, None if steps else options.get("step_tolerance"))
    budget, j2 = _budget(scene, options["law"], block, path)
    halved = all(n % 2 == 0 and n >= 8 for n in scene.surface.shape)
    if j2 is None:
        return Checked(budget, halved)
    effective = measured_hardness(scene, coarse=halved, j2=j2, **block, **path)
    largest = j2.final.quantities["largest_pressure"] / scene.material.yield_stress
    return Checked(budget, halved, effective, largest)


def _surface_lines(checked: Checked, hardness: float) -> list[str]:
    """Return the lines of the report on one surface."""
    lines = [str(checked.budget)]
    model = checked.budget.model
    if model is not None:
        unit = "hardness" if math.isfinite(hardness) else "mean contact pressure"
        cap = "capped" if math.isfinite(hardness) else "elastic"
        lines.append(
            f"j2 touches on {model.areas[0]:.4f}, the {cap} body on {model.areas[1]:.4f} of the "
            f"nodes; overlap {model.overlap:.2f}; distance of the pressure distributions "
            f"{model.wasserstein:.3f} of the {unit}"
        )
        no_half = "" if checked.halved else "; no coarser grid in the error"
        lines.append(f"{checked.effective}{no_half}")
    return lines


def _ensemble_lines(checks: Sequence[Checked]) -> list[str]:
    """Return the lines of the report on all surfaces together."""
    budgets = [item.budget for item in checks]
    rows = [("discretisation, area", [b.discretisation.area for b in budgets])]
    models = [b.model for b in budgets if b.model is not None]
    if models:
        rows.append(("model, area", [m.area for m in models]))
        rows.append(("model, overlap", [m.overlap for m in models]))
        rows.append(("model, distance of the pressures", [m.wasserstein for m in models]))
        rows.append(("largest pressure of j2 over sigma_Y", [item.largest for item in checks]))
    effective = [e for item in checks if (e := item.effective) is not None and not e.saturated]
    caps = [e.at_cap for e in effective if e.at_cap is not None]
    if caps and len(caps) == len(checks):
        rows.append(("effective hardness c_eff", [e.ratio for e in effective]))
        rows += [
            (f"its change by the {name}", [e.parts[name] for e in effective])
            for name in effective[0].parts
            if name != "node"
        ]
        rows.append(("overlap at c_eff", [cap.overlap for cap in caps]))
    lines = [f"{name}: {_spread(values)}" for name, values in rows]
    if caps and len(caps) == len(checks):
        lines.append(_mean_hardness(effective))
    return lines


def _mean_hardness(effective: Sequence[EffectiveHardness]) -> str:
    """Return the mean c_eff with its error from the seeds and from what all surfaces share."""
    ratios = [e.ratio for e in effective]
    parts = {"seeds": standard_deviation(ratios) / math.sqrt(len(ratios))}
    for name in effective[0].parts:
        if name != "node":  # half a node more or less averages out
            parts[name] = estimate([e.parts[name] for e in effective]).mean
    listed = ", ".join(f"{name} {part:+.3f}" for name, part in parts.items())
    mean, error = estimate(ratios).mean, combined(parts)
    return f"mean c_eff = {mean:.3f} +- {error:.3f} (by {listed})"


def _spread(values: Sequence[float]) -> str:
    deviation = standard_deviation(values)
    error = deviation / math.sqrt(len(values))
    return f"{estimate(values).mean:+.4f} +- {error:.4f} ({deviation:.4f})"
