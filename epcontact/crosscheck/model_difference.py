"""The difference between J2 flow and a pressure cap on one body.

The boundary elements use the surface compliance of the finite-element block, as
measured by `fem_check.surface_compliance`.  Both bodies then have the same heights,
load and linear answer to every pressure wave, so grid and depth cancel and the rest of
the difference is physics, not error. Gates read it as quantity.model_*,
quantity.effective_* and quantity.elements_*.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase
from epcontact.harness.gates import Difference, difference, l2_distance
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.roughness import rms_slope
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

#: Relative width at which the search for a ratio stops: the area moves by less than a
#: node.
_SEARCHED_TO = 1e-4
#: Largest contact area at which an effective hardness says something of the material.
#: Beyond it nearly every node touches, and the cap of equal area is hardly more than
#: the mean pressure.
_SATURATED = 0.9
#: Parts of an error that are a change between two solves of first order, and count this
#: much.  Two solves cannot show their order: three times the change is the grid
#: convergence index of two grids (Roache 1994, Journal of Fluids Engineering 116, 405).
_TWO_SOLVES = {"grid": 3.0, "steps": 3.0}


@dataclass(frozen=True)
class EffectiveHardness:
    """The cap at which the capped body has the contact area of the J2 body.

    `ratio` is c_eff = hardness/sigma_Y, infinite if even the elastic body has at least
    that area; `severity` E* xi/sigma_Y; `area` the raw contact area of the J2 body;
    `at_cap` the difference of the two bodies under that cap.  `parts` are those of the
    ratio's error: the effect of half a "node" in the area and, each from a second solve
    that differs in one thing, the change from a "grid" twice as coarse, from a "depth"
    of three quarters, and from half as many load "steps".
    """

    ratio: float
    severity: float
    area: float
    at_cap: Difference | None = None
    parts: Mapping[str, float] = field(default_factory=dict)

    @property
    def meaningless(self) -> str:
        """The sentence that says why the contact is too full for a ratio; empty if it
        is not.
        """
        if self.area <= _SATURATED:
            return ""
        return (
            f"c_eff means nothing where the J2 body touches on {self.area:.3f} of "
            "the nodes: in so "
            "full a contact the cap of equal area follows the load and not the material"
        )

    @property
    def error(self) -> float:
        """The error of the ratio, meant to cover in 95 of 100 scenes; see
        `combined`.
        """
        return combined(self.parts)

    def __str__(self) -> str:
        parts = ", ".join(f"{name} {part:+.3f}" for name, part in self.parts.items())
        at_cap = self.at_cap
        return self.meaningless or (
            f"c_eff = {self.ratio:.3f} +- {self.error:.3f} at E*ξ/σ_Y = "
            f"{self.severity:.3g} "
            f"(by {parts})"
            + (f" ({at_cap}, overlap {at_cap.overlap:.2f})" if at_cap else "")
        )


def combined(parts: Mapping[str, float]) -> float:
    """Return the root of the sum of the squares of an error's parts, each times its
    factor.  Such bars of 57 of 60 small scenes hold the ratio of a fine grid
    (tests/test_crosscheck.py).
    """
    return math.hypot(
        *(_TWO_SOLVES.get(name, 1.0) * part for name, part in parts.items())
    )


def elements_compliance(scene: Scene, result: ContactResult) -> FloatArray | None:
    """Return the compliance (m/Pa, as `bem.solve` takes it) of the block of elements
    that answered. None if the body is the half-space itself, as that of volume
    integrals.  Raises InvalidCase if the result does not describe its block.
    """
    options = result.provenance.options
    if options.get("compliance") == "half_space":
        return None
    # A layer's depth is the scene's own.
    names = ("layers", "first_layer") + (
        ("depth",) if scene.body.kind == "half_space" else ()
    )
    if missing := [name for name in names if name not in options]:
        raise InvalidCase(
            f"the result of {result.method} does not say its block's {missing[0]}, "
            "so the "
            "difference that the law alone makes cannot be measured"
        )
    block = {name: options[name] for name in names}
    return np.asarray(fem_check.surface_compliance(scene, **block))


def capped_body(
    scene: Scene, hardness: float, compliance: FloatArray | None
) -> ContactResult:
    """Solve by boundary elements under a cap (Pa) on a compliance (None: the exact
    one).
    """
    material = replace(scene.material, hardness=hardness)
    return bem.solve(
        replace(scene, material=material), compliance=compliance, threads=1
    )


def hardness_of_equal_area(scene: Scene, j2: ContactResult) -> EffectiveHardness:
    """Find the cap of equal area by bisection; its error is the effect of half a
    node.
    """
    wanted, material = j2.final.areas["raw"].total, scene.material
    compliance = elements_compliance(scene, j2)
    severity = effective_modulus(material) * rms_slope(scene) / material.yield_stress

    @cache
    def area_at(ratio: float) -> float:
        """Return the raw area under a cap of this ratio times the yield stress."""
        answer = capped_body(scene, ratio * material.yield_stress, compliance)
        return answer.final.areas["raw"].total

    if area_at(math.inf) >= wanted:
        return EffectiveHardness(math.inf, severity, wanted)
    # Under the smallest cap that can carry the load every node touches.
    ratios = [scene.load.final / material.yield_stress * 1.001, 8.0]
    while area_at(ratios[-1]) >= wanted:
        ratios.append(2 * ratios[-1])

    def passed(target: float) -> float:
        """The ratio at which the area, which falls with the ratio, passes a target."""
        last = next(
            k for k, ratio in enumerate(ratios) if k and area_at(ratio) <= target
        )
        a, b = ratios[last - 1], ratios[last]
        while b - a > _SEARCHED_TO * b:
            middle = math.sqrt(a * b)
            a, b = (middle, b) if area_at(middle) > target else (a, middle)
        return math.sqrt(a * b)

    # The area jumps by whole nodes: both ends of the interval with the wanted area are
    # searched.
    half_a_node = 0.5 / scene.surface.heights.size
    low, high = (passed(wanted + half) for half in (half_a_node, -half_a_node))
    cap = (low + high) / 2 * material.yield_stress
    at_cap = difference(j2, capped_body(scene, cap, compliance), cap)
    parts = {"node": abs(high - low) / 2}
    return EffectiveHardness((low + high) / 2, severity, wanted, at_cap, parts)


# --- the quantities: each solve is made once for all that need it
# --------------------------------

_J2, _J2_AND_CAP = ("fields", "J2 flow"), ("fields", "J2 flow", "hardness")
_MODEL = {
    "area": (
        "A_J2/A_cap - 1 of the raw areas, with the cap at the hardness of the scene"
    ),
    "overlap": (
        "shared contact nodes over the nodes in either contact, of J2 and the same cap"
    ),
    "distance": (
        "Wasserstein distance of the pressures of J2 and the same cap, over the "
        "hardness"
    ),
}
_EFFECTIVE = {
    "hardness": (
        "c_eff: the cap over yield_stress at which the capped body has the area of "
        "the J2 body"
    ),
    "overlap": (
        "shared contact nodes over the nodes in either contact, of J2 and the cap c_eff"
    ),
}


@quantity("–", _J2_AND_CAP, "model_{}", each=_MODEL)
def model(solved: SolvedScene, part: str) -> float:
    """{}."""
    found = difference(
        solved.result, solved.once(_capped), solved.scene.material.hardness
    )
    return {
        "area": found.area,
        "overlap": found.overlap,
        "distance": found.wasserstein,
    }[part]


@quantity("–", _J2, "effective_{}", each=_EFFECTIVE)
def effective(solved: SolvedScene, part: str) -> float:
    """{}."""
    ratio, at_cap = solved.once(_effective)
    return ratio if part == "hardness" else at_cap.overlap


@quantity("–")
def elements_pressure(solved: SolvedScene) -> float:
    """L2 difference of the pressures, elastic or capped, from those of boundary
    elements on the compliance of the elements, over their L2 norm.
    """
    if (law := solved.result.provenance.options.get("law")) == "j2":
        raise InvalidCase(
            "the law of the elements is j2, but their own body has a linear law"
        )
    hardness = solved.scene.material.hardness if law == "capped" else math.inf
    own = capped_body(
        solved.scene, hardness, elements_compliance(solved.scene, solved.result)
    )
    return l2_distance(solved.result.fields["pressure"], own.fields["pressure"])


@quantity("–", _J2)
def elements_area(solved: SolvedScene) -> float:
    """A_cap/A - 1, with A_cap on the compliance of the elements and A on the exact one.

    It is the effect of the finite-element grid, an error that falls with the spacing.
    """
    hardness = solved.scene.material.hardness
    return difference(
        solved.once(_capped), capped_body(solved.scene, hardness, None), hardness
    ).area


def _require_j2(solved: SolvedScene) -> None:
    """Raise InvalidCase unless the result is that of a body with J2 flow."""
    if not solved.flows:
        law = solved.result.provenance.options.get("law")
        raise InvalidCase(
            f"the law of the elements is {law}, but a model gate needs j2"
        )


def _capped(solved: SolvedScene) -> ContactResult:
    """Solve the body under a cap at the hardness of the scene."""
    _require_j2(solved)
    compliance = elements_compliance(solved.scene, solved.result)
    return capped_body(solved.scene, solved.scene.material.hardness, compliance)


def _effective(solved: SolvedScene) -> tuple[float, Difference]:
    """Return c_eff, and the difference from the body under that cap; raise if there is
    none.
    """
    _require_j2(solved)
    found = hardness_of_equal_area(solved.scene, solved.result)
    if found.meaningless:
        raise InvalidCase(f"{found.meaningless}; gate it under a smaller load")
    if found.at_cap is None:
        raise InvalidCase(
            "the J2 body touches on no more than the elastic one, so no cap gives "
            "its area; "
            "a gate on the effective hardness needs a larger E*ξ/σ_Y"
        )
    return found.ratio, found.at_cap
