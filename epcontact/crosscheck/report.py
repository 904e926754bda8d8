"""The reasons why finite and boundary elements differ on a scene, each measured
separately.

A comparison of the two is a chain of solves in which one thing changes at a time:

    finite elements, law ---- boundary elements on the elements' own surface compliance
        solver          same law, same discrete body: the difference is rounding alone
    ---- boundary elements on the exact layer of the elements' depth
        discretisation  same law, same depth: the elements against the exact kernel
    ---- boundary elements on the scene's own body
        depth           same law, both by boundary elements: the depth alone

and, where the finite elements flow by J2, before all of these,

    finite elements, j2 ---- boundary elements capped at the hardness, on the elements'
    compliance
        model           plastic flow against a pressure cap: physics, not error.

`measured_hardness` turns the model part into a number: the cap, in units of the yield
stress, at which the capped body has the contact area of the J2 body under the same
load.  `crosscheck` reports these for each surface of a case and for their ensemble.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import fem_check
from epcontact import bem
from epcontact.crosscheck.model_difference import (
    EffectiveHardness,
    combined,
    hardness_of_equal_area,
)
from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import Difference, difference, estimate, standard_deviation
from epcontact.harness.methods.registry import METHODS
from epcontact.peers import calculix
from epcontact.results import ContactResult
from epcontact.scene import Body, Load, Scene, Surface
from epcontact.surfaces import SelfAffine

#: Rows of the ensemble: c_eff, and the parts of its error.
_C_EFF, _CHANGE = "effective hardness c_eff", "its change by the "


def error_budget(
    scene: Scene, law: str = "capped", j2: ContactResult | None = None, **block: Any
) -> dict[str, Difference]:
    """Split the difference between finite and boundary elements under a single load.

    Args:
        scene: the scene.
        law: of the linear part of the chain: "capped", or "elastic" without a hardness.
        j2: the result of `fem_check.solve` by the law j2, whose difference from the
            next one is the part "model"; None: there is no such part.
        block: the depth and the layers of `fem_check.solve`.

    Returns:
        The parts of the difference by name, in the order of the chain.
    """
    hardness = math.inf if law == "elastic" else scene.material.hardness
    capped = replace(scene, material=replace(scene.material, hardness=hardness))
    linear_law: Literal["capped", "elastic"] = "elastic"
    if math.isfinite(hardness):
        linear_law = "capped"
    elements = fem_check.solve(capped, law=linear_law, **block)
    compliance = fem_check.surface_compliance(scene, **block)
    on_compliance = bem.solve(capped, compliance=compliance)
    body = scene.body
    if body.kind == "half_space":
        depth = float(elements.provenance.options["depth"])
        body = Body("bonded_layer", depth)
    on_layer = bem.solve(replace(capped, body=body))
    on_body = on_layer if body == scene.body else bem.solve(capped)
    parts = {} if j2 is None else {"model": difference(j2, on_compliance, hardness)}
    parts["solver"] = difference(elements, on_compliance, hardness)
    parts["discretisation"] = difference(on_compliance, on_layer, hardness)
    parts["depth"] = difference(on_layer, on_body, hardness)
    return parts


def measured_hardness(
    scene: Scene, *, j2: ContactResult | None = None, **options: Any
) -> EffectiveHardness:
    """Return the effective hardness of the J2 body of a scene, with the parts of its
    error.

    `epcontact.effective_hardness` looks it up in a map of such measurements.  The scene
    is also solved on every other grid point, on a shallower block (of a half-space) and
    in half as many increments; if the grid has no half, the error is that of half a
    node alone.

    Args:
        scene: the scene, under a single load.
        j2: its result by `fem_check.solve` and the law j2; None: it is solved here.
        options: depth, layers and steps of `fem_check.solve`.
    """
    j2 = j2 or _solve_j2(scene, **options)
    fine = hardness_of_equal_area(scene, j2)
    coarse_scene = _on_half_grid(scene)
    if fine.meaningless or math.isinf(fine.ratio) or coarse_scene is None:
        return fine
    others = {"grid": (coarse_scene, _solve_j2(coarse_scene, **options))}
    if scene.body.kind == "half_space":
        depth = 0.75 * float(j2.provenance.options["depth"])
        others["depth"] = (scene, _solve_j2(scene, **{**options, "depth": depth}))
    steps = max(1, round(j2.provenance.options["steps"] / 2))
    others["steps"] = (scene, _solve_j2(scene, **{**options, "steps": steps}))
    parts = {}
    for name, (other_scene, result) in others.items():
        parts[name] = fine.ratio - hardness_of_equal_area(other_scene, result).ratio
    return replace(fine, parts={**parts, **fine.parts})


def _solve_j2(scene: Scene, **options: Any) -> ContactResult:
    return fem_check.solve(scene, law="j2", certified=False, **options)


def _on_half_grid(scene: Scene) -> Scene | None:
    """Return the scene on every other grid point; None if its grid has no half."""
    heights, periods = scene.surface.heights, scene.surface.periods
    if any(n % 2 or n < 8 for n in heights.shape):
        return None
    heights = heights[(slice(None, None, 2),) * heights.ndim]
    surface = Surface(heights, periods)
    return replace(scene, surface=surface, load=Load(scene.load.final))


# --- the report on a case


def crosscheck(
    case: Case, seeds: Sequence[int] = (), *, steps: int | None = None
) -> str:
    """Report why the finite and the boundary elements of a case differ, surface by
    surface.

    The report holds the error budget of the case's finite-element law; for j2 also both
    contact areas, their overlap, the distance of the pressure distributions, and the
    effective hardness; for several surfaces their means with standard errors.

    Args:
        case: a case with the methods fem and bem, under a single load.
        seeds: of random surfaces, instead of the case's own; (): the case's.
        steps: the increments of the J2 body; None: the case's.

    Raises:
        InvalidCase: if the case cannot be cross-checked.
    """
    _require_comparable(case, seeds, steps)
    steps = steps or case.options["fem"]["steps"]
    recipes: Sequence[Any] = case.recipes
    if seeds:
        recipes = [replace(recipes[0], seed=seed) for seed in seeds]
    lines, rows = [], []
    for recipe in recipes:
        seed = getattr(recipe, "seed", None)
        surface = "" if seed is None else f", seed {seed}"
        lines.append(f"{case.id}, {case.size}{surface}")
        of_surface, row = _check_surface(case, case.scene(recipe), steps)
        lines += [f"  {line}" for line in of_surface]
        rows.append(row)
    if len(rows) > 1:
        lines.append(
            f"{case.id}, {case.size}, {len(rows)} surfaces: mean +- standard error "
            "(standard deviation of a surface)"
        )
        lines += [f"  {line}" for line in _ensemble_lines(rows)]
    return "\n".join(lines)


def _require_comparable(case: Case, seeds: Sequence[int], steps: int | None) -> None:
    """Raise InvalidCase if a case cannot be cross-checked on these seeds and
    increments.
    """
    for obstacle in _obstacles(case, seeds, steps):
        raise InvalidCase(f"{case.path}: {obstacle}")


def _obstacles(case: Case, seeds: Sequence[int], steps: int | None) -> Iterator[str]:
    """Yield why a case cannot be cross-checked."""
    if case.skip:
        yield case.skip
    missing = [method for method in ("fem", "bem") if method not in case.methods]
    if missing:
        yield (
            f"case.methods lacks {' and '.join(missing)}; a cross-check needs both fem "
            "and bem"
        )
    fem, loads = case.options.get("fem", {}), len(case.load.path)
    if loads != 1:
        yield (
            f"load.mean_pressure is a path of {loads}, but a cross-check answers a "
            "single mean pressure"
        )
    if fem.get("geometry") != "gap":
        yield (
            f"fem.geometry is {fem.get('geometry')!r}, but must be 'gap': the boundary "
            "elements have no other, so slope and error could not be separated"
        )
    if steps and fem.get("law") != "j2":
        yield "steps is for fem.law = 'j2' only"
    if seeds and not (case.recipes and isinstance(case.recipes[0], SelfAffine)):
        yield "its surface is not random, so it has no seeds"
    if len(set(seeds)) != len(seeds) or min(seeds, default=0) < 0:
        yield f"seeds are {list(seeds)}, but must be different numbers from 0 on"


def _check_surface(
    case: Case, scene: Scene, steps: int
) -> tuple[list[str], dict[str, float]]:
    """Return the lines of the report on a surface, and its row of the ensemble."""
    options = case.options["fem"]
    law = options["law"]
    block: dict[str, Any] = {key: options.get(key) for key in ("depth", "layers")}
    j2 = None
    if law == "j2":
        j2 = fem_check.solve(scene, law="j2", **block, steps=steps)
    budget = error_budget(scene, law, j2, **block)
    parts = {name: f"{name}: {part}" for name, part in budget.items()}
    parts["solver"] += f" ({budget['solver'].nodes} nodes)"
    lines = [f"fem {law} against bem: {'; '.join(parts.values())}"]
    if {"calculix", "tamaas_j2"} & set(case.methods) and law != "capped":
        lines += _table_of_codes(case, scene)
    row = {"discretisation, area": budget["discretisation"].area}
    if j2 is None:
        return lines, row
    model = budget["model"]
    body, unit = "elastic", "mean contact pressure"
    if math.isfinite(scene.material.hardness):
        body, unit = "capped", "hardness"
    lines.append(
        f"j2 touches on {model.areas[0]:.4f}, the {body} body on {model.areas[1]:.4f} "
        f"of the nodes; overlap {model.overlap:.2f}; distance of the pressure "
        f"distributions {model.wasserstein:.3f} of the {unit}"
    )
    measured = measured_hardness(scene, j2=j2, **block, steps=steps)
    note = "" if _on_half_grid(scene) else "; no coarser grid in the error"
    lines.append(f"{measured}{note}")
    largest = j2.final.quantities["largest_pressure"]
    row["model, area"] = model.area
    row["model, overlap"] = model.overlap
    row["model, distance of the pressures"] = model.wasserstein
    row["largest pressure of j2 over sigma_Y"] = largest / scene.material.yield_stress
    if measured.at_cap is not None and not measured.meaningless:
        row[_C_EFF] = measured.ratio
        for name, part in measured.parts.items():
            if name != "node":
                row[_CHANGE + name] = part
        row["overlap at c_eff"] = measured.at_cap.overlap
    return lines, row


# --- the table of codes

#: The head of the table, and the form of its rows.
_HEAD = (
    "code                              raw corrected  c_eff  nodes distr.  time "
    "unknowns iter."
)
_ROW = "{:30} {:6.4f} {:9.4f} {:6.3f} {:6.4f} {:6.4f} {:5.3g} {:8.0f} {:5.0f}"
#: A surface of this fraction of its slope, of a stiffer body, has a similar result,
#: with this fraction of the large displacements.
_GENTLE = 0.1


def _table_of_codes(case: Case, scene: Scene) -> list[str]:
    """Return a table of the codes that are installed.

    It has their areas, c_eff, distances of the pressures from those of the elements at
    the nodes (L2) and of the distribution, and times over theirs on one thread.
    """
    flows = case.options["fem"]["law"] == "j2"
    lines = [_HEAD]
    elements = None
    for name, (solved, solve) in _solves_of_codes(case, scene).items():
        try:
            result = solve()
        except NotConverged as error:
            lines.append(f"{name}: {error}")
            continue
        elements = elements or result  # those of the elements come first
        away = difference(result, elements, math.inf)
        ratio = hardness_of_equal_area(solved, result).ratio if flows else math.nan
        cost = result.cost
        row = (
            name,
            result.final.areas["raw"].total,
            result.final.areas["corrected"].total,
            ratio,
            away.pressure,
            away.wasserstein,
            cost["seconds"] / elements.cost["seconds"],
            cost["unknowns"],
            cost.get("iterations", cost.get("newton_steps", 0)),
        )
        lines.append(_ROW.format(*row).replace("nan", "  –"))
    return lines


def _solves_of_codes(
    case: Case, scene: Scene
) -> dict[str, tuple[Scene, Callable[[], ContactResult]]]:
    """Return the scene and the solve of each row of the table, the elements' first.

    CalculiX is asked again with one thing changed.
    """
    options = {**case.options["fem"], "certified": False}
    solves: dict[str, tuple[Scene, Callable[[], ContactResult]]] = {}
    for name, method in METHODS.items():
        has_options = method.table == "fem"
        comparable = method.has_model_measures and not method.missing
        if comparable and (options["law"] == "j2" or has_options):
            given = options if has_options else {}
            solves[name] = (scene, partial(method.solve, scene, given, 1))
    if "calculix" in solves:
        for name, change in calculix.CHANGES.items():
            solves[name] = (scene, partial(calculix.solve, scene, options, **change))
        gentle = _similar_scene(scene)
        solve = partial(calculix.solve, gentle, options)
        solves["calculix, a tenth of the slope"] = (gentle, solve)
    return solves


def _similar_scene(scene: Scene) -> Scene:
    """Return a scene of the same result with a tenth of the slope."""
    surface = replace(scene.surface, heights=_GENTLE * scene.surface.heights)
    stiffer = scene.material.young_modulus / _GENTLE
    material = replace(scene.material, young_modulus=stiffer)
    return replace(scene, surface=surface, material=material)


# --- several surfaces


def _ensemble_lines(rows: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the lines on the quantities that every surface has."""
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    means, errors, lines = {}, {}, []
    for name in shared:
        values = [row[name] for row in rows]
        deviation = standard_deviation(values)
        means[name] = estimate(values).mean
        errors[name] = deviation / math.sqrt(len(values))
        lines.append(
            f"{name}: {means[name]:+.4f} +- {errors[name]:.4f} ({deviation:.4f})"
        )
    if _C_EFF in means:
        # The scatter of the surfaces averages out, and so does half a node more or
        # less; the other parts of the error do not.
        parts = {"seeds": errors[_C_EFF]}
        for name in shared:
            if name.startswith(_CHANGE):
                parts[name.removeprefix(_CHANGE)] = means[name]
        listed = ", ".join(f"{name} {part:+.3f}" for name, part in parts.items())
        lines.append(
            f"mean c_eff = {means[_C_EFF]:.3f} +- {combined(parts):.3f} (by {listed})"
        )
    return lines
