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

#: Relative width of the interval at which the search for a ratio stops.  Over such an
#: interval the area changes by less than a node.
_SEARCH_WIDTH = 1e-4
#: Ratio hardness/sigma_Y at which the search for an upper bound starts.
_LARGEST_RATIO = 8.0
#: Largest contact area, as a fraction of the nominal area, at which an effective
#: hardness describes the material.  In a fuller contact nearly every node touches, and
#: the cap of equal area is hardly more than the mean pressure.
_SATURATED = 0.9
#: Factors of those parts of an error that are a change between two solves.  Two solves
#: cannot show their order of convergence: three times the change is the grid
#: convergence index of two grids (Roache 1994, Journal of Fluids Engineering 116, 405).
_TWO_SOLVES = {"grid": 3.0, "steps": 3.0}


@dataclass(frozen=True)
class EffectiveHardness:
    """The hardness at which the capped body has the contact area of the J2 body.

    Attributes:
        ratio: c_eff = hardness/sigma_Y; infinite if even the elastic body has at least
            the contact area of the J2 body.
        severity: E* xi/sigma_Y, with the rms slope xi.
        area: raw contact area of the J2 body, as a fraction of the nominal area.
        at_cap: difference of the J2 body from the body under that cap; None if the
            ratio is infinite.
        parts: parts of the ratio's error by name.  "node" is the effect of half a node
            in the area.  The others are changes from a second solve that differs in one
            thing: "grid" is twice as coarse, "depth" is three quarters of the block's
            depth, "steps" is half as many load increments.
    """

    ratio: float
    severity: float
    area: float
    at_cap: Difference | None = None
    parts: Mapping[str, float] = field(default_factory=dict)

    @property
    def meaningless(self) -> str:
        """The sentence that says why there is no ratio; empty if there is one.

        The contact may be too full, or no larger than that of the elastic body.
        """
        if math.isinf(self.ratio):
            return (
                f"there is no c_eff: the J2 body touches on {self.area:.3f} of the "
                "nodes, no more than the elastic body; a larger E*ξ/σ_Y or load is "
                "needed"
            )
        if self.area <= _SATURATED:
            return ""
        return (
            f"c_eff means nothing where the J2 body touches on {self.area:.3f} of "
            "the nodes: in so full a contact the cap of equal area follows the load "
            "and not the material"
        )

    @property
    def error(self) -> float:
        """Half-width of the 95 % interval of the ratio, see `combined`."""
        return combined(self.parts)

    def __str__(self) -> str:
        """Return the ratio with its error and the parts, or why it has no meaning."""
        if self.meaningless:
            return self.meaningless
        text = f"c_eff = {self.ratio:.3f}"
        if math.isfinite(self.error):
            text += f" +- {self.error:.3f}"
        text += f" at E*ξ/σ_Y = {self.severity:.3g}"
        listed = []
        for name, part in self.parts.items():
            if math.isfinite(part):
                listed.append(f"{name} {part:+.3f}")
            else:
                listed.append(f"{name} unknown: no c_eff in its second solve")
        text += f" (by {', '.join(listed)})"
        if self.at_cap:
            text += f" ({self.at_cap}, overlap {self.at_cap.overlap:.2f})"
        return text


def combined(parts: Mapping[str, float]) -> float:
    """Return the half-width of the 95 % interval of c_eff from the parts of its error.

    It is the root of the sum of squares of the parts, after "grid" and "steps" are
    multiplied by 3.  For 57 of 60 small scenes the interval contains the ratio of a
    fine grid (tests/test_crosscheck.py).

    Args:
        parts: errors of c_eff by name, as `EffectiveHardness.parts`; signs do not
            matter.
    """
    scaled = [_TWO_SOLVES.get(name, 1.0) * part for name, part in parts.items()]
    return math.hypot(*scaled)


def elements_compliance(scene: Scene, result: ContactResult) -> FloatArray | None:
    """Return the surface compliance of the block on which a result was solved.

    Args:
        scene: the scene of the result.
        result: the result of a method that solves the solid; its provenance has the
            depth and layers of the block.

    Returns:
        The compliance in m/Pa at each wave vector, of the shape that `bem.solve` takes.
        None if the body is the half-space itself, as for volume integrals.

    Raises:
        InvalidCase: if the provenance lacks the depth or the layers.
    """
    options = result.provenance.options
    if options.get("compliance") == "half_space":
        return None
    names = ["layers", "first_layer"]
    if scene.body.kind == "half_space":  # else the scene has the depth of its layer
        names.append("depth")
    for name in names:
        if name not in options:
            raise InvalidCase(
                f"the result of {result.method} does not say its block's {name}, so "
                "the difference that the law alone makes cannot be measured"
            )
    block = {name: options[name] for name in names}
    return np.asarray(fem_check.surface_compliance(scene, **block))


def capped_body(
    scene: Scene, hardness: float, compliance: FloatArray | None
) -> ContactResult:
    """Return the result of boundary elements for a scene with another hardness.

    Args:
        scene: the scene, whose own hardness is not used.
        hardness: the cap on the pressure in Pa; infinite for an elastic body.
        compliance: from `elements_compliance`, in m/Pa; None: that of the scene's body.

    Raises:
        InvalidScene: if the hardness cannot carry the load.
        NotConverged: if the solve does not converge.
    """
    material = replace(scene.material, hardness=hardness)
    return bem.solve(
        replace(scene, material=material), compliance=compliance, threads=1
    )


def hardness_of_equal_area(scene: Scene, j2: ContactResult) -> EffectiveHardness:
    """Return the hardness at which the capped body has the contact area of a J2 body.

    The hardness is found by bisection, with boundary elements on the compliance of the
    J2 body's block.  The error has one part, "node": the effect of half a node in the
    area.

    Args:
        scene: the scene, with a yield stress and a single load.
        j2: its result with J2 flow.

    Raises:
        InvalidCase: as `elements_compliance`.
        NotConverged: if boundary elements do not converge.
    """
    material = scene.material
    wanted = j2.final.areas["raw"].total
    compliance = elements_compliance(scene, j2)
    severity = effective_modulus(material) * rms_slope(scene) / material.yield_stress

    @cache
    def area_at(ratio: float) -> float:
        """Return the raw area (fraction) at a ratio hardness/sigma_Y; decreasing."""
        capped = capped_body(scene, ratio * material.yield_stress, compliance)
        return capped.final.areas["raw"].total

    if area_at(math.inf) >= wanted:
        return EffectiveHardness(math.inf, severity, wanted)
    # Under the smallest cap that can carry the load every node touches.
    smallest = scene.load.final / material.yield_stress * 1.001
    ratios = [smallest, _LARGEST_RATIO]
    while area_at(ratios[-1]) >= wanted:
        ratios.append(2 * ratios[-1])

    def ratio_at(area: float) -> float:
        """Return the ratio at which the area decreases through a value (fraction)."""
        index = 1
        while area_at(ratios[index]) > area:
            index += 1
        low = ratios[index - 1]
        high = ratios[index]
        while high - low > _SEARCH_WIDTH * high:
            middle = math.sqrt(low * high)
            if area_at(middle) > area:
                low = middle
            else:
                high = middle
        return math.sqrt(low * high)

    # The area changes by complete nodes: an interval of ratios has the wanted area, and
    # both of its bounds are searched.
    half_a_node = 0.5 / scene.surface.heights.size
    lowest = ratio_at(wanted + half_a_node)
    highest = ratio_at(wanted - half_a_node)
    ratio = (lowest + highest) / 2
    cap = ratio * material.yield_stress
    at_cap = difference(j2, capped_body(scene, cap, compliance), cap)
    parts = {"node": abs(highest - lowest) / 2}
    return EffectiveHardness(ratio, severity, wanted, at_cap, parts)


# --- the quantities of gates; `solved.once` shares a solve between them

#: What the quantities need, see `quantity`: fields on the grid, a result with J2 flow
#: and, for a cap, a finite hardness of the scene.
_J2 = ("fields", "J2 flow")
_J2_AND_CAP = (*_J2, "hardness")
#: Meanings of the quantities quantity.model_* and quantity.effective_*, by last word.
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
    """{}.

    The first line is a template for the meaning of quantity.model_<part>, dimensionless
    and measured on a solved scene with J2 flow.  `part` is area, overlap or distance.
    Raises InvalidCase if the result is not one with J2 flow.
    """
    hardness = solved.scene.material.hardness
    from_cap = difference(solved.result, solved.once(_solve_capped), hardness)
    values = {
        "area": from_cap.area,
        "overlap": from_cap.overlap,
        "distance": from_cap.wasserstein,
    }
    return values[part]


@quantity("–", _J2, "effective_{}", each=_EFFECTIVE)
def effective(solved: SolvedScene, part: str) -> float:
    """{}.

    The first line is a template for the meaning of quantity.effective_<part>,
    dimensionless and measured on a solved scene with J2 flow.  `part` is hardness or
    overlap.  Raises InvalidCase if no cap has the area of the J2 body.
    """
    ratio, at_cap = solved.once(_measure_effective)
    if part == "hardness":
        return ratio
    return at_cap.overlap


@quantity("–")
def elements_pressure(solved: SolvedScene) -> float:
    """L2 difference of the pressures, elastic or capped, from those of boundary
    elements on the compliance of the elements, over their L2 norm.

    Raises InvalidCase if the law of the elements is j2.
    """
    law = solved.result.provenance.options.get("law")
    if law == "j2":
        raise InvalidCase(
            "the law of the elements is j2, but their own body has a linear law"
        )
    hardness = math.inf
    if law == "capped":
        hardness = solved.scene.material.hardness
    compliance = elements_compliance(solved.scene, solved.result)
    by_boundary = capped_body(solved.scene, hardness, compliance)
    return l2_distance(solved.result.fields["pressure"], by_boundary.fields["pressure"])


@quantity("–", _J2)
def elements_area(solved: SolvedScene) -> float:
    """A_cap/A - 1, with A_cap on the compliance of the elements and A on the exact one.

    Both are raw contact areas by boundary elements at the hardness of the scene.  The
    quantity is the error of the finite-element grid, which decreases with the spacing.
    Raises InvalidCase if the result is not one with J2 flow.
    """
    hardness = solved.scene.material.hardness
    exact = capped_body(solved.scene, hardness, None)
    return difference(solved.once(_solve_capped), exact, hardness).area


def _require_j2(solved: SolvedScene) -> None:
    """Raise InvalidCase unless the result of a solved scene is one with J2 flow."""
    if not solved.flows:
        law = solved.result.provenance.options.get("law")
        raise InvalidCase(
            f"the law of the elements is {law}, but a model gate needs j2"
        )


def _solve_capped(solved: SolvedScene) -> ContactResult:
    """Return the result of boundary elements at the hardness of the scene.

    They use the compliance of the block on which the scene was solved.  Raises
    InvalidCase if the result is not one with J2 flow.
    """
    _require_j2(solved)
    compliance = elements_compliance(solved.scene, solved.result)
    return capped_body(solved.scene, solved.scene.material.hardness, compliance)


def _measure_effective(solved: SolvedScene) -> tuple[float, Difference]:
    """Return c_eff of a result with J2 flow, and the difference from the capped body.

    c_eff is hardness/sigma_Y of the capped body that has the same contact area.  Raises
    InvalidCase if the result has no J2 flow, if the contact is too full, or if no cap
    has its area.
    """
    _require_j2(solved)
    measured = hardness_of_equal_area(solved.scene, solved.result)
    if measured.at_cap is None:
        raise InvalidCase(
            "the J2 body touches on no more than the elastic one, so no cap gives "
            "its area; a gate on the effective hardness needs a larger E*ξ/σ_Y"
        )
    if measured.meaningless:
        raise InvalidCase(f"{measured.meaningless}; gate it under a smaller load")
    return measured.ratio, measured.at_cap
