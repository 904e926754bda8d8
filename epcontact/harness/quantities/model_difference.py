"""The difference between J2 flow and a pressure cap on one body.

The boundary elements use the surface compliance of the finite-element block, as measured by
`fem_check.surface_compliance`.  Both bodies then have the same heights, load and linear answer to
every pressure wave, so grid and depth cancel and the rest of the difference is physics, not error.
Gates read it as quantity.model_*, quantity.effective_* and quantity.elements_area (see
`registry`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.gates.distances import Difference, difference, l2_distance
from epcontact.harness.methods.registry import EITHER_WAY
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.roughness import rms_slope
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Load, Scene, Surface

#: Relative width at which the search for a ratio stops: the area moves by less than a node.
_SEARCHED_TO = 1e-4


#: Largest contact area at which an effective hardness says something of the material.  Beyond it
#: nearly every node touches, and the cap of equal area is hardly more than the mean pressure.
SATURATED = 0.9
#: Factor of the change between two solves, by the part of the error; see `combined`.
TWO_SOLVES = {"grid": 3.0, "steps": 3.0}


@dataclass(frozen=True)
class EffectiveHardness:
    """The cap at which the capped body has the contact area of the J2 body.

    Attributes:
        ratio: c_eff = hardness/sigma_Y; infinite if even the elastic body has at least that area.
        severity: E* xi/sigma_Y of the scene.
        area: raw contact area of the J2 body.
        at_cap: the difference of the two bodies under that cap.
        parts: parts of the error of the ratio, by name: "node", the effect of half a node in the
            area; and, each from a second solve that differs in one thing, the change of the ratio
            from a "grid" twice as coarse, from a "depth" of three quarters, and from half as many
            load "steps".
    """

    ratio: float
    severity: float
    area: float
    at_cap: Difference | None
    parts: Mapping[str, float]

    @property
    def saturated(self) -> bool:
        """True if the contact is too full for the ratio to mean anything."""
        return self.area > SATURATED

    @property
    def error(self) -> float:
        """The error of the ratio, meant to cover in 95 of 100 scenes; see `combined`."""
        return combined(self.parts)

    def __str__(self) -> str:
        if self.saturated:
            return _full(self.area)
        parts = ", ".join(f"{name} {part:+.3f}" for name, part in self.parts.items())
        return (
            f"c_eff = {self.ratio:.3f} +- {self.error:.3f} at E*ξ/σ_Y = {self.severity:.3g} "
            f"(by {parts})"
            + (
                ""
                if self.at_cap is None
                else f" ({self.at_cap}, overlap {self.at_cap.overlap:.2f})"
            )
        )


def _full(area: float) -> str:
    return (
        f"c_eff means nothing where the J2 body touches on {area:.3f} of the nodes: in so full a "
        "contact the cap of equal area follows the load and not the material"
    )


def combined(parts: Mapping[str, float]) -> float:
    """Return the root of the sum of the squares of an error's parts.

    The errors of grid and steps are of first order, so that the change from twice as coarse a solve
    is the finer one's own error, if both are fine enough for that order to rule.  As two solves
    cannot show that, these changes count three times, which is the grid convergence index of two
    grids (Roache 1994, Journal of Fluids Engineering 116, 405).  The error bars of 19 of 20 small
    scenes then hold the ratio of a fine grid (tests/test_crosscheck.py), and of 12 without it.
    """
    return math.hypot(*(TWO_SOLVES.get(name, 1.0) * part for name, part in parts.items()))


def effective_hardness(
    scene: Scene,
    *,
    coarse: bool = True,
    depth: float | None = None,
    layers: int | None = None,
    steps: int | None = None,
    step_tolerance: float | None = None,
    j2: ContactResult | None = None,
) -> EffectiveHardness:
    """Find the effective hardness of the J2 body of a scene under its single load.

    Args:
        scene: the scene; its hardness is not read.
        coarse: also solve on every other grid point, on a shallower block (of a half-space) and in
            fewer steps; otherwise the error is that of half a node alone.
        depth: depth of the element block in m; None: chosen from the scene.
        layers: number of element layers; None: chosen from the scene.
        steps, step_tolerance: of the load path, as for `fem_check.solve`.
        j2: the answer of `fem_check.solve` to this scene and these options, if it is already known.

    Raises:
        InvalidScene: for a path of loads, or for an odd number of grid points with `coarse`.
    """
    if len(scene.load.path) != 1:
        raise InvalidScene(
            f"the scene has a path of {len(scene.load.path)} mean pressures; give a single one"
        )
    block: dict[str, Any] = {"depth": depth, "layers": layers}
    path = path_options(steps, step_tolerance)
    if j2 is None:
        j2 = fem_check.solve(scene, law="j2", certified=False, **block, **path)
    fine = _equal_area(scene, j2)
    if fine.saturated or not (coarse and math.isfinite(fine.ratio)):
        return fine
    if any(n % 2 or n < 8 for n in scene.surface.shape):
        raise InvalidScene(
            f"the grid of {scene.surface.shape} points has no half; give even numbers of at "
            "least 8, or coarse=False"
        )
    half = _half(scene)
    others = {"grid": (half, fem_check.solve(half, law="j2", certified=False, **block, **path))}
    if scene.body.kind == "half_space":
        block["depth"] = 0.75 * float(j2.provenance.options["depth"])
        found = fem_check.solve(scene, law="j2", certified=False, **block, **path)
        others["depth"] = (scene, found)
        block["depth"] = depth
    path = {"steps": _half_the_steps(j2)}
    others["steps"] = (scene, fem_check.solve(scene, law="j2", certified=False, **block, **path))
    parts = {name: fine.ratio - _equal_area(*other).ratio for name, other in others.items()}
    return replace(fine, parts=parts | dict(fine.parts))


def path_options(steps: int | None, step_tolerance: float | None) -> dict[str, Any]:
    """Return the options of `fem_check.solve` that choose the increments; None is its default.

    Raises:
        InvalidCase: if both are given.
    """
    if steps is not None and step_tolerance is not None:
        raise InvalidCase(EITHER_WAY)
    given = {"steps": steps, "step_tolerance": step_tolerance}
    return {name: value for name, value in given.items() if value is not None}


def _half_the_steps(j2: ContactResult) -> int:
    """Half of the increments of a J2 answer; of chosen ones, a third was made to judge the rest."""
    steps = j2.provenance.options["steps"] or round(2 / 3 * j2.cost["increments"])
    return max(1, round(steps / 2))


def elements_compliance(scene: Scene, result: ContactResult) -> FloatArray | None:
    """Return the surface compliance of the body of a J2 result: of the block of its elements.

    Returns:
        The compliance in m/Pa, one value for each mode of numpy.fft.rfftn; None if the body is the
        half-space itself, as that of volume integrals.

    Raises:
        InvalidCase: if the result does not describe its block.
    """
    options = result.provenance.options
    if options.get("compliance") == "half_space":
        return None
    # A layer's depth is the scene's own.
    names = ("layers", "first_layer") + (("depth",) if scene.body.kind == "half_space" else ())
    try:
        block = {name: options[name] for name in names}
    except KeyError as missing:
        raise InvalidCase(
            f"the result of {result.method} does not say its block's {missing.args[0]}, so the "
            "difference that the law alone makes cannot be measured"
        ) from None
    return np.asarray(fem_check.surface_compliance(scene, **block))


def capped_body(scene: Scene, hardness: float, compliance: FloatArray | None) -> ContactResult:
    """Solve by boundary elements under a cap (Pa) on a compliance (None: the exact one)."""
    material = replace(scene.material, hardness=hardness)
    return bem.solve(replace(scene, material=material), compliance=compliance, threads=1)


class ModelDifference:
    """Comparisons of an answer of the elements with bodies on its compliance, each solved once.

    Args:
        scene: the scene that was solved.
        j2: the answer of the finite elements to it, with its fields; by J2 flow but for
            `elements_pressure`.

    Raises:
        InvalidCase: if the result is not that of a block of elements.
    """

    def __init__(self, scene: Scene, j2: ContactResult) -> None:
        self.law = j2.provenance.options.get("law")
        self.scene, self.j2 = scene, j2
        self.compliance = elements_compliance(scene, j2)

    def _require_j2(self) -> None:
        if self.law != "j2":
            raise InvalidCase(f"the law of the elements is {self.law}, but a model gate needs j2")

    @cached_property
    def elements_pressure(self) -> float:
        """L2 difference of elastic or capped pressures from those of the same discrete body.

        Raises InvalidCase if the body flows by J2.
        """
        if self.law == "j2":
            raise InvalidCase("the law of the elements is j2, but their own body has a linear law")
        hardness = self.scene.material.hardness if self.law == "capped" else math.inf
        own = capped_body(self.scene, hardness, self.compliance)
        return l2_distance(self.j2.fields["pressure"], own.fields["pressure"])

    @cached_property
    def _capped(self) -> ContactResult:
        self._require_j2()
        return capped_body(self.scene, self.scene.material.hardness, self.compliance)

    @cached_property
    def at_hardness(self) -> Difference:
        """The difference of the J2 body from the body capped at the hardness of the scene."""
        return difference(self.j2, self._capped, self.scene.material.hardness)

    @cached_property
    def effective(self) -> EffectiveHardness:
        """The cap of equal contact area.

        Raises InvalidCase if there is none, or the contact is too full for it to mean anything.
        """
        self._require_j2()
        effective = _equal_area(self.scene, self.j2)
        if effective.saturated:
            raise InvalidCase(f"{_full(effective.area)}; gate it under a smaller load")
        if effective.at_cap is None:
            raise InvalidCase(
                "the J2 body touches on no more than the elastic one, so no cap gives its area; "
                "a gate on the effective hardness needs a larger E*ξ/σ_Y"
            )
        return effective

    @property
    def effective_difference(self) -> Difference:
        """The difference of the J2 body from the body under the cap of equal contact area."""
        at_cap = self.effective.at_cap
        assert at_cap is not None
        return at_cap

    @cached_property
    def elements_area(self) -> float:
        """A_cap/A - 1, with A_cap on the compliance of the elements and A on the exact one.

        It is the effect of the finite-element grid, an error that falls with the spacing.
        """
        hardness = self.scene.material.hardness
        return difference(self._capped, capped_body(self.scene, hardness, None), hardness).area


def _equal_area(scene: Scene, j2: ContactResult) -> EffectiveHardness:
    """Find the cap of equal area by bisection; its error is the effect of half a node."""
    wanted = j2.final.areas["raw"].total
    compliance = elements_compliance(scene, j2)
    material = scene.material
    severity = effective_modulus(material) * rms_slope(scene) / material.yield_stress

    def area_at(ratio: float) -> float:
        answer = capped_body(scene, ratio * material.yield_stress, compliance)
        return answer.final.areas["raw"].total

    if area_at(math.inf) >= wanted:
        return EffectiveHardness(math.inf, severity, wanted, None, {})
    # Under the smallest cap that can carry the load every node touches.
    areas = {scene.load.final / material.yield_stress * 1.001: 1.0}
    high = 8.0
    while (area := area_at(high)) >= wanted:
        areas[high] = area
        high *= 2
    areas[high] = area
    count = scene.surface.heights.size
    edges = []
    # The area jumps by whole nodes, so both ends of the interval of ratios with the wanted area are
    # searched.  The area falls with the ratio: the second search reuses the areas of the first.
    for target in (wanted + 0.5 / count, wanted - 0.5 / count):
        a = max((r for r, area in areas.items() if area > target), default=min(areas))
        b = min((r for r, area in areas.items() if area <= target and r > a), default=high)
        while b - a > _SEARCHED_TO * b:
            middle = math.sqrt(a * b)
            areas[middle] = area_at(middle)
            a, b = (middle, b) if areas[middle] > target else (a, middle)
        edges.append(math.sqrt(a * b))
    ratio = (edges[0] + edges[1]) / 2
    cap = ratio * material.yield_stress
    at_cap = difference(j2, capped_body(scene, cap, compliance), cap)
    node = abs(edges[1] - edges[0]) / 2
    return EffectiveHardness(ratio, severity, wanted, at_cap, {"node": node})


def _half(scene: Scene) -> Scene:
    """Return the scene on every other grid point."""
    heights = scene.surface.heights[(slice(None, None, 2),) * scene.surface.heights.ndim]
    surface = Surface(heights, scene.surface.periods)
    return replace(scene, surface=surface, load=Load(scene.load.final))
