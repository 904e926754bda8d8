"""Quantities that need a second solve of the same finite elements.

A rough top is part of the mesh with `geometry = "moved"`; with "gap" the block is flat.
quantity.moved_* is what the slope of the rough top changes.  quantity.limit_pressure is
the pressure at which a body flows freely, found by a load that it cannot carry.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import fem_check
from epcontact.errors import InvalidCase
from epcontact.harness.gates import difference
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.results import ContactResult
from epcontact.scene import Load
from fem_check.free_flow import FlowsFreely

#: Mean pressure on the contact over the yield stress that no flat punch carries: limit
#: analysis gives at most 3.3.
_BEYOND_LIMIT = 4.0


def solve_again(
    solved: SolvedScene, load: Load | None = None, **changes: Any
) -> ContactResult:
    """Return a second result of the finite elements that solved a scene.

    Args:
        solved: the scene and its result by finite elements.
        load: instead of the scene's; None: the scene's.
        changes: options of the elements by name that differ from those of the result.
    """
    scene = replace(solved.scene, load=load or solved.scene.load)
    options = {**solved.result.provenance.options, **changes}
    if scene.body.kind != "half_space":
        del options["depth"]  # that of the layer, up to rounding
    return fem_check.solve(scene, certified=False, threads=solved.threads, **options)


#: Meanings of the quantities quantity.moved_*, by last word.
_MOVED = {
    "area": "A_moved/A_gap - 1 of the raw areas",
    "pressure": "L2 difference of the pressures, over the L2 norm of those of the gap",
    "peak": "largest pressure over that of the gap, less 1",
}


@quantity("–", name="moved_{}", each=_MOVED)
def moved(solved: SolvedScene, part: str) -> float:
    """{}, of a rough top and of a flat top with the gap.

    The first line is a template for the meaning of quantity.moved_<part>.  `part` is
    area, pressure or peak.  Raises InvalidCase if the top nodes are not moved.
    """
    geometry = solved.result.provenance.options.get("geometry")
    if geometry != "moved":
        raise InvalidCase(
            f"the geometry is {geometry}, but a rough top needs geometry = 'moved'"
        )
    flat = solved.once(_solve_flat)
    from_flat = difference(solved.result, flat, solved.scene.material.hardness)
    values = {
        "area": from_flat.area,
        "pressure": from_flat.pressure,
        "peak": float(solved.pressure.max() / flat.fields["pressure"].max()) - 1,
    }
    return values[part]


def _solve_flat(solved: SolvedScene) -> ContactResult:
    """Return the result of the same elements with a flat top and the gap."""
    return solve_again(solved, geometry="gap")


@quantity("Pa")
def limit_pressure(solved: SolvedScene) -> float:
    """mean pressure on the contact at which the body flows freely.

    The contact is that of the scene, and must not grow, such as that of a flat punch.
    Raises InvalidCase if the body carries four yield stresses on it.
    """
    area = solved.result.final.areas["raw"].total
    beyond = _BEYOND_LIMIT * solved.scene.material.yield_stress * area
    try:
        solve_again(solved, Load(beyond))
    except FlowsFreely as error:
        return error.limit / area
    raise InvalidCase("the body carries four yield stresses and does not flow freely")
