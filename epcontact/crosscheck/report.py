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
from collections.abc import Mapping, Sequence
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
    """Split the difference between finite and boundary elements under a single load, by
    its parts. `block` is the depth and the layers of `fem_check.solve`, whose answer by
    the law j2 is `j2`: after it the chain goes on with the capped law or, without a
    hardness, with the elastic one.
    """
    hardness = math.inf if law == "elastic" else scene.material.hardness
    capped = replace(scene, material=replace(scene.material, hardness=hardness))
    linear_law: Literal["capped", "elastic"] = (
        "capped" if math.isfinite(hardness) else "elastic"
    )
    fem = fem_check.solve(capped, law=linear_law, **block)
    own = bem.solve(capped, compliance=fem_check.surface_compliance(scene, **block))
    body = scene.body
    if body.kind == "half_space":
        body = Body("bonded_layer", float(fem.provenance.options["depth"]))
    layer = bem.solve(replace(capped, body=body))
    whole = layer if body == scene.body else bem.solve(capped)
    chain = {"model": (j2, own), "solver": (fem, own)}
    chain |= {"discretisation": (own, layer), "depth": (layer, whole)}
    return {
        name: difference(a, b, hardness)
        for name, (a, b) in chain.items()
        if a is not None
    }


def measured_hardness(
    scene: Scene, *, j2: ContactResult | None = None, **options: Any
) -> EffectiveHardness:
    """Measure the effective hardness of the J2 body of a scene, and the parts of its
    error.

    `epcontact.effective_hardness` looks it up in a map of such measurements.  The scene
    is also solved on every other grid point, on a shallower block (of a half-space) and
    in half as many increments; if the grid has no half, the error is that of half a
    node alone.  `options` are depth, layers and steps of `fem_check.solve`; `j2` is its
    answer if that is known.
    """

    def flowed(body: Scene, **options: Any) -> ContactResult:
        """Return the result of a scene by J2 finite elements."""
        return fem_check.solve(body, law="j2", certified=False, **options)

    j2 = j2 or flowed(scene, **options)
    fine, half = hardness_of_equal_area(scene, j2), _half(scene)
    if fine.meaningless or math.isinf(fine.ratio) or half is None:
        return fine
    others = {"grid": (half, flowed(half, **options))}
    if scene.body.kind == "half_space":
        depth = 0.75 * float(j2.provenance.options["depth"])
        others["depth"] = (scene, flowed(scene, **options | {"depth": depth}))
    fewer = max(1, round(j2.provenance.options["steps"] / 2))
    others["steps"] = (scene, flowed(scene, **options | {"steps": fewer}))
    parts = {
        name: fine.ratio - hardness_of_equal_area(*other).ratio
        for name, other in others.items()
    }
    return replace(fine, parts=parts | dict(fine.parts))


def _half(scene: Scene) -> Scene | None:
    """Return the scene on every other grid point; None if its grid has no half."""
    heights, periods = scene.surface.heights, scene.surface.periods
    if any(n % 2 or n < 8 for n in heights.shape):
        return None
    heights = heights[(slice(None, None, 2),) * heights.ndim]
    return replace(
        scene, surface=Surface(heights, periods), load=Load(scene.load.final)
    )


# --- the report on a case
# ------------------------------------------------------------------------


def crosscheck(
    case: Case, seeds: Sequence[int] = (), *, steps: int | None = None
) -> str:
    """Report why the finite and the boundary elements of a case differ, surface by
    surface.

    The report holds the error budget of the case's finite-element law; for j2 also both
    contact areas, their overlap, the distance of the pressure distributions, and the
    effective hardness; for several surfaces their means with standard errors.  `seeds`
    replace the case's own, `steps` the increments of its J2 body.
    """
    _require_comparable(case, seeds, steps)
    steps = steps or case.options["fem"]["steps"]
    recipes: Sequence[Any] = case.recipes
    lines, rows = [], []
    for recipe in [replace(recipes[0], seed=seed) for seed in seeds] or recipes:
        seed = getattr(recipe, "seed", None)
        lines.append(
            f"{case.id}, {case.size}" + ("" if seed is None else f", seed {seed}")
        )
        found, row = _checked(case, case.scene(recipe), steps)
        lines += [f"  {line}" for line in found]
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
    missing = [method for method in ("fem", "bem") if method not in case.methods]
    fem, loads = case.options.get("fem", {}), len(case.load.path)
    random = isinstance(case.recipes[0], SelfAffine) if case.recipes else False
    obstacles = {
        case.skip: case.skip,
        f"case.methods lacks {' and '.join(missing)}; a cross-check needs both fem and "
        "bem": missing,
        f"load.mean_pressure is a path of {loads}, but a cross-check answers a single mean "
        "pressure": loads != 1,
        f"fem.geometry is {fem.get('geometry')!r}, but must be 'gap': the boundary elements have "
        "no other, so slope and error could not be separated": fem.get("geometry")
        != "gap",
        "steps is for fem.law = 'j2' only": steps and fem.get("law") != "j2",
        "its surface is not random, so it has no seeds": seeds and not random,
        f"seeds are {list(seeds)}, but must be different numbers from 0 on": len(
            set(seeds)
        )
        != len(seeds)
        or min(seeds, default=0) < 0,
    }
    if obstacle := next(
        (sentence for sentence, wrong in obstacles.items() if wrong), ""
    ):
        raise InvalidCase(f"{case.path}: {obstacle}")


def _checked(
    case: Case, scene: Scene, steps: int
) -> tuple[list[str], dict[str, float]]:
    """Return the lines of the report on a surface, and its row of the ensemble."""
    law = case.options["fem"]["law"]
    block: dict[str, Any] = {k: case.options["fem"].get(k) for k in ("depth", "layers")}
    j2 = fem_check.solve(scene, law="j2", **block, steps=steps) if law == "j2" else None
    budget = error_budget(scene, law, j2, **block)
    parts = {name: f"{name}: {part}" for name, part in budget.items()}
    parts["solver"] += f" ({budget['solver'].nodes} nodes)"
    lines = [f"fem {law} against bem: {'; '.join(parts.values())}"]
    if {"calculix", "tamaas_j2"} & set(case.methods) and law != "capped":
        lines += _codes(case, scene)
    row = {"discretisation, area": budget["discretisation"].area}
    if j2 is None:
        return lines, row
    model, capped = budget["model"], math.isfinite(scene.material.hardness)
    cap, unit = (
        ("capped", "hardness") if capped else ("elastic", "mean contact pressure")
    )
    lines.append(
        f"j2 touches on {model.areas[0]:.4f}, the {cap} body on {model.areas[1]:.4f} of the "
        f"nodes; overlap {model.overlap:.2f}; distance of the pressure distributions "
        f"{model.wasserstein:.3f} of the {unit}"
    )
    found = measured_hardness(scene, j2=j2, **block, steps=steps)
    lines.append(f"{found}{'' if _half(scene) else '; no coarser grid in the error'}")
    largest = j2.final.quantities["largest_pressure"] / scene.material.yield_stress
    row |= {
        "model, area": model.area,
        "model, overlap": model.overlap,
        "model, distance of the pressures": model.wasserstein,
        "largest pressure of j2 over sigma_Y": largest,
    }
    if found.at_cap is not None and not found.meaningless:
        changes = {
            _CHANGE + name: part for name, part in found.parts.items() if name != "node"
        }
        row |= (
            {_C_EFF: found.ratio} | changes | {"overlap at c_eff": found.at_cap.overlap}
        )
    return lines, row


#: The head of the table of codes, and the form of its rows.
_HEAD = "code                              raw corrected  c_eff  nodes distr.  time unknowns iter."
_ROW = "{:30} {:6.4f} {:9.4f} {:6.3f} {:6.4f} {:6.4f} {:5.3g} {:8.0f} {:5.0f}"


def _codes(case: Case, scene: Scene) -> list[str]:
    """Return a table of the codes that are installed: areas, c_eff, distances of the
    pressures from the elements' at the nodes (L2) and of the distribution, and times
    over theirs on one thread. CalculiX is asked again with one thing changed; of
    similar answers, that at a tenth of the slope has a tenth of the large
    displacements.
    """
    options = dict(case.options["fem"]) | {"certified": False}
    flows = options["law"] == "j2"
    flat = replace(scene.surface, heights=0.1 * scene.surface.heights)
    stiff = replace(scene.material, young_modulus=10 * scene.material.young_modulus)
    gentle = replace(scene, surface=flat, material=stiff)
    asked = {
        name: (
            scene,
            partial(method.solve, scene, options if method.table == "fem" else {}, 1),
        )
        for name, method in METHODS.items()
        if method.has_model_measures
        and not method.missing
        and (flows or method.table == "fem")
    }
    if "calculix" in asked:
        for name, change in calculix.CHANGES.items():
            asked[name] = (scene, partial(calculix.solve, scene, options, **change))
        name = "calculix, a tenth of the slope"
        asked[name] = (gentle, partial(calculix.solve, gentle, options))
    rows, own = [_HEAD], None
    for name, (body, solve) in asked.items():
        try:
            result = solve()
        except NotConverged as error:
            rows.append(f"{name}: {error}")
            continue
        own = own or result  # that of the elements, which come first
        away, areas, cost = (
            difference(result, own, math.inf),
            result.final.areas,
            result.cost,
        )
        row = (
            name,
            areas["raw"].total,
            areas["corrected"].total,
            hardness_of_equal_area(body, result).ratio if flows else math.nan,
            away.pressure,
            away.wasserstein,
            cost["seconds"] / own.cost["seconds"],
            cost["unknowns"],
            cost.get("iterations", cost.get("newton_steps", 0)),
        )
        rows.append(_ROW.format(*row).replace("nan", "  –"))
    return rows


def _ensemble_lines(rows: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the lines of the report on all surfaces together: what each of them
    has.
    """
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    means, errors, lines = {}, {}, []
    for name in shared:
        values = [row[name] for row in rows]
        deviation = standard_deviation(values)
        means[name], errors[name] = (
            estimate(values).mean,
            deviation / math.sqrt(len(values)),
        )
        lines.append(
            f"{name}: {means[name]:+.4f} +- {errors[name]:.4f} ({deviation:.4f})"
        )
    if _C_EFF in means:
        # The scatter of the surfaces averages out, and half a node more or less; the
        # rest does not.
        changes = (name for name in shared if name.startswith(_CHANGE))
        parts = {"seeds": errors[_C_EFF]}
        parts |= {name.removeprefix(_CHANGE): means[name] for name in changes}
        listed = ", ".join(f"{name} {part:+.3f}" for name, part in parts.items())
        lines.append(
            f"mean c_eff = {means[_C_EFF]:.3f} +- {combined(parts):.3f} (by {listed})"
        )
    return lines
