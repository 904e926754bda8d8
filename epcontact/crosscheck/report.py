"""Reasons why finite and boundary elements differ on a scene, measured separately.

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

#: Names of values in the report on several surfaces: c_eff = hardness/sigma_Y and, with
#: the name of a part of its error behind it, each change of c_eff.
_C_EFF = "effective hardness c_eff"
_CHANGE = "its change by the "


def error_budget(
    scene: Scene, law: str = "capped", j2: ContactResult | None = None, **block: Any
) -> dict[str, Difference]:
    """Split the difference between finite and boundary elements under a single load.

    The head of this module describes the chain of solves.

    Args:
        scene: the scene, under a single mean pressure.
        law: "elastic": the bodies of the chain are elastic; else they are capped at the
            scene's hardness, which may be infinite.
        j2: the scene's result by `fem_check.solve` with the law j2.  Its difference
            from boundary elements on the same compliance is the part "model"; None:
            there is no such part.
        block: the options depth (m) and layers of `fem_check.solve`.

    Returns:
        The parts of the difference: "model" (if `j2` is given), "solver",
        "discretisation" and "depth".

    Raises:
        InvalidScene: if the options do not fit the scene.
        NotConverged: if a solve does not converge.
    """
    hardness = scene.material.hardness
    if law == "elastic":
        hardness = math.inf
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
    on_body = on_layer
    if body != scene.body:
        on_body = bem.solve(capped)
    parts = {} if j2 is None else {"model": difference(j2, on_compliance, hardness)}
    parts["solver"] = difference(elements, on_compliance, hardness)
    parts["discretisation"] = difference(on_compliance, on_layer, hardness)
    parts["depth"] = difference(on_layer, on_body, hardness)
    return parts


def measured_hardness(
    scene: Scene, *, j2: ContactResult | None = None, **options: Any
) -> EffectiveHardness:
    """Measure the effective hardness of the J2 body of a scene, with its error.

    `epcontact.effective_hardness` interpolates a map of such measurements.  For the
    error the scene is also solved on every other grid point, on a shallower block (if
    the body is a half-space) and in half as many increments.  If every other grid point
    makes no grid, the error is that of half a node alone.

    Args:
        scene: the scene, with a yield stress and a single mean pressure.
        j2: its result by `fem_check.solve` with the law j2; None: it is solved here.
        options: depth (m), layers and steps of `fem_check.solve`.

    Raises:
        InvalidScene: if the options do not fit the scene.
        NotConverged: if a solve does not converge.
    """
    j2 = j2 or _solve_j2(scene, **options)
    fine = hardness_of_equal_area(scene, j2)
    coarse_scene = _on_half_grid(scene)
    if fine.meaningless or coarse_scene is None:
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
    """Return the result of finite elements with J2 flow, without the certificate.

    `options` are further ones of `fem_check.solve`.  Raises InvalidScene if they do not
    fit the scene, and NotConverged if the solve fails.
    """
    return fem_check.solve(scene, law="j2", certified=False, **options)


def _on_half_grid(scene: Scene) -> Scene | None:
    """Return the scene on every other grid point, under its last load.

    None if the number of points along a direction is odd or below 8.
    """
    heights = scene.surface.heights
    if any(n % 2 or n < 8 for n in heights.shape):
        return None
    heights = heights[(slice(None, None, 2),) * heights.ndim]
    surface = Surface(heights, scene.surface.periods)
    return replace(scene, surface=surface, load=Load(scene.load.final))


# --- the report on a case


def crosscheck(
    case: Case, seeds: Sequence[int] = (), *, steps: int | None = None
) -> str:
    """Report why finite and boundary elements of a case differ, for each surface.

    The report has the error budget of the case's finite-element law.  For j2 it also
    has both contact areas, their overlap, the distance of the pressure distributions
    and the effective hardness.  For several surfaces it has means with standard errors.

    Args:
        case: a case with the methods fem and bem, under a single mean pressure.
        seeds: seeds of random surfaces that replace those of the case; (): the case's.
        steps: number of load increments of the J2 body; None: the case's.

    Returns:
        The report, lines of text without a final line break.

    Raises:
        InvalidCase: if the case cannot be cross-checked.
        NotConverged: if a solve does not converge.
    """
    for obstacle in _obstacles(case, seeds, steps):
        raise InvalidCase(f"{case.path}: {obstacle}")
    steps = steps or case.options["fem"]["steps"]
    recipes: Sequence[Any] = case.recipes
    if seeds:
        recipes = [replace(recipes[0], seed=seed) for seed in seeds]
    lines, rows = [], []
    for recipe in recipes:
        seed = getattr(recipe, "seed", None)
        title = f"{case.id}, {case.size}"
        if seed is not None:
            title += f", seed {seed}"
        lines.append(title)
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


def _obstacles(case: Case, seeds: Sequence[int], steps: int | None) -> Iterator[str]:
    """Yield the reasons, as sentences, why a case cannot be cross-checked.

    `seeds` and `steps` are those of `crosscheck`, which raises the first reason.
    """
    if case.skip:
        yield case.skip
    missing = [method for method in ("fem", "bem") if method not in case.methods]
    if missing:
        yield (
            f"case.methods lacks {' and '.join(missing)}; a cross-check needs both fem "
            "and bem"
        )
    fem = case.options.get("fem", {})
    loads = len(case.load.path)
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
    """Solve and compare one surface of a case.

    Args:
        case: the case, with options of finite elements.
        scene: the case's scene on that surface.
        steps: number of load increments of a J2 body.

    Returns:
        The lines of the report on the surface, and its dimensionless values by name,
        for the means over surfaces.

    Raises:
        NotConverged: if a solve does not converge.
    """
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
    line = str(measured)
    if _on_half_grid(scene) is None:
        line += "; no coarser grid in the error"
    lines.append(line)
    largest = j2.final.quantities["largest_pressure"]
    row["model, area"] = model.area
    row["model, overlap"] = model.overlap
    row["model, distance of the pressures"] = model.wasserstein
    row["largest pressure of j2 over sigma_Y"] = largest / scene.material.yield_stress
    has_ratio = measured.at_cap is not None and not measured.meaningless
    if has_ratio and math.isfinite(measured.error):
        assert measured.at_cap is not None
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
#: Factor on the heights of a surface, with a body that is stiffer by its inverse.  The
#: result of small displacements is the same; effects of large displacements decrease by
#: this factor.
_GENTLE = 0.1


def _table_of_codes(case: Case, scene: Scene) -> list[str]:
    """Return the lines of a table of all installed codes that solve a case.

    The columns are: raw and corrected area (fractions), c_eff = hardness/sigma_Y, L2
    norm of the difference of the nodal pressures from those of `fem_check` over the
    norm of these, distance of the pressure distributions, time over that of `fem_check`
    (one thread), unknowns, iterations.  A code that does not converge has a line with
    the reason.

    Args:
        case: the case, with options of finite elements.
        scene: its scene on one surface.
    """
    is_j2 = case.options["fem"]["law"] == "j2"
    lines = [_HEAD]
    elements = None
    for name, (solved, solve) in _solves_of_codes(case, scene).items():
        try:
            result = solve()
        except NotConverged as error:
            lines.append(f"{name}: {error}")
            continue
        elements = elements or result  # `fem_check` is the first of the codes
        away = difference(result, elements, math.inf)
        ratio = math.nan
        if is_j2:
            measured = hardness_of_equal_area(solved, result)
            if not measured.meaningless:
                ratio = measured.ratio
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
    """Return the scene and a function that solves it, for each row of the table.

    The first row is `fem_check`.  CalculiX has further rows, in each of which one
    choice differs.

    Args:
        case: the case, with options of finite elements.
        scene: its scene on one surface.
    """
    options = {**case.options["fem"], "certified": False}
    solves: dict[str, tuple[Scene, Callable[[], ContactResult]]] = {}
    for name, method in METHODS.items():
        has_options = method.table == "fem"
        comparable = method.has_model_measures and not method.missing
        if comparable and (options["law"] == "j2" or has_options):
            given: dict[str, Any] = {}
            if has_options:
                given = options
            solves[name] = (scene, partial(method.solve, scene, given, 1))
    if "calculix" in solves:
        for name, change in calculix.CHANGES.items():
            solves[name] = (scene, partial(calculix.solve, scene, options, **change))
        gentle = _similar_scene(scene)
        solve = partial(calculix.solve, gentle, options)
        solves["calculix, a tenth of the slope"] = (gentle, solve)
    return solves


def _similar_scene(scene: Scene) -> Scene:
    """Return a scene with a tenth of the slope and ten times Young's modulus.

    Contact areas and pressures are those of the given scene, except for effects of
    large displacements.
    """
    surface = replace(scene.surface, heights=_GENTLE * scene.surface.heights)
    stiffer = scene.material.young_modulus / _GENTLE
    material = replace(scene.material, young_modulus=stiffer)
    return replace(scene, surface=surface, material=material)


# --- several surfaces


def _ensemble_lines(rows: Sequence[Mapping[str, float]]) -> list[str]:
    """Return lines with the mean of each value that all surfaces have.

    Each mean has its standard error and, in brackets, the standard deviation between
    surfaces.

    Args:
        rows: the values by name of each surface, from `_check_surface`; two or more.
    """
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
        # The scatter of surfaces and the error of half a node decrease in the mean; the
        # other parts of the error do not.
        parts = {"seeds": errors[_C_EFF]}
        for name in shared:
            if name.startswith(_CHANGE):
                parts[name.removeprefix(_CHANGE)] = means[name]
        listed = ", ".join(f"{name} {part:+.3f}" for name, part in parts.items())
        lines.append(
            f"mean c_eff = {means[_C_EFF]:.3f} +- {combined(parts):.3f} (by {listed})"
        )
    return lines
