"""Why the finite and the boundary elements differ on a scene, part by part, each part measured.

Every comparison of the two is a chain of solves in which one thing changes at a time:

    finite elements, law ---- boundary elements on the elements' own surface compliance
        solver          same law, same discrete body: what is left is rounding
    ---- boundary elements on the exact layer of the elements' depth
        discretisation  same law, same depth: the elements against the continuum's kernel
    ---- boundary elements on the scene's own body
        depth           from the kernel alone

and, where the finite elements flow by J2, before all of these,

    finite elements, j2 ---- boundary elements capped at the hardness, on the elements' compliance
        model           plastic flow against a pressure cap: physics, not error.

`effective_hardness` turns the last one into a number: the cap, in units of the yield stress, at
which the capped body has the contact area of the J2 body under the same load.  `crosscheck` says
all of it of a case.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import fem_check
from epcontact import bem
from epcontact.casefile import Case
from epcontact.compare import distance
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.results import APART, ContactResult
from epcontact.scene import Body, Load, Scene, Surface

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Difference:
    """Of one answer from another.

    area: relative difference of the raw contact areas.  pressure: L2 norm of the difference of
    the nodal pressures over that of the second.  overlap: shared contact nodes over all nodes in
    either contact (Jaccard).  wasserstein: distance of the pressure distributions, as in
    `compare`.  nodes: how many differ in being in contact.  areas: both raw areas.
    """

    area: float
    pressure: float
    overlap: float
    wasserstein: float
    nodes: int
    areas: tuple[float, float]

    def __str__(self) -> str:
        return f"area {self.area:+.2%}, pressure {self.pressure:.1e}"


def difference(first: ContactResult, second: ContactResult, hardness: float) -> Difference:
    """Of `first` from `second`, on one grid; hardness (Pa) scales the distributions' distance."""
    p, q = first.fields["pressure"], second.fields["pressure"]
    if p.shape != q.shape:
        raise InvalidScene(f"pressures on grids of {p.shape} and {q.shape} cannot be compared")
    a, b = first.fields["state"] != APART, second.fields["state"] != APART
    assert first.distribution is not None
    assert second.distribution is not None
    return Difference(
        float(a.mean() / b.mean() - 1),
        float(np.linalg.norm(p - q) / np.linalg.norm(q)),
        float((a & b).sum() / (a | b).sum()),
        distance("wasserstein", first.distribution, second.distribution, hardness),
        int((a != b).sum()),
        (float(a.mean()), float(b.mean())),
    )


@dataclass(frozen=True)
class ErrorBudget:
    """The parts of a difference, in the order of the chain; `model` is None but for j2."""

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
    report: Callable[[str], None] | None = print,
) -> ErrorBudget:
    """Splits the difference of finite and boundary elements on `scene` into its parts.

    law: of the finite elements.  With j2 the chain continues by the capped law if the scene has
        a hardness, by the elastic one if not.
    depth (m), layers: of the elements, chosen from the scene where not given.
    report: is told the budget in one line; None: nobody.

    Raises what the two solvers raise; InvalidScene for a path of loads.
    """
    _require_one_load(scene)
    block: dict[str, Any] = {"depth": depth, "layers": layers}
    hardness = scene.material.hardness
    if law == "elastic":
        hardness = math.inf
    capped = replace(scene, material=replace(scene.material, hardness=hardness))
    linear_law = "capped" if math.isfinite(hardness) else "elastic"
    fem = fem_check.solve(capped, law=linear_law, **block)
    own = bem.solve(capped, compliance=fem_check.surface_compliance(scene, **block))
    body = scene.body
    if body.kind == "half_space":
        body = Body("bonded_layer", float(fem.provenance.options["depth"]))
    layer = bem.solve(replace(capped, body=body))
    whole = layer if body == scene.body else bem.solve(capped)
    model = None
    if law == "j2":
        model = difference(fem_check.solve(scene, law="j2", **block), own, hardness)
    budget = ErrorBudget(
        law,
        model,
        difference(fem, own, hardness),
        difference(own, layer, hardness),
        difference(layer, whole, hardness),
    )
    if report is not None:
        report(str(budget))
    return budget


@dataclass(frozen=True)
class EffectiveHardness:
    """The cap at which the capped body has the contact area of the J2 body.

    ratio: c_eff = hardness/sigma_Y; infinite where even the elastic body has at least that area.
    error: of the ratio: its change from the twice as coarse grid, which first-order convergence
        makes the error left on the fine one, and what half a node in the area does to it.
    severity: E* xi/sigma_Y.  area: raw, of the J2 body.  at_cap: how the two differ there.
    """

    ratio: float
    error: float
    severity: float
    area: float
    at_cap: Difference | None

    def __str__(self) -> str:
        return (
            f"c_eff = {self.ratio:.3f} +- {self.error:.3f} at E* xi/sigma_Y = {self.severity:.3g}"
            + (
                ""
                if self.at_cap is None
                else f" ({self.at_cap}, overlap {self.at_cap.overlap:.2f})"
            )
        )


def effective_hardness(
    scene: Scene, *, coarse: bool = True, depth: float | None = None, layers: int | None = None
) -> EffectiveHardness:
    """The effective hardness of a scene's J2 body under its one load; its hardness is not read.

    coarse: solve on every other grid point too, for the error; else that part of it is missing.
    depth (m), layers: of the elements, chosen from the scene where not given.

    Raises InvalidScene for a path, or a grid of an odd number of points with `coarse`.
    """
    _require_one_load(scene)
    block: dict[str, Any] = {"depth": depth, "layers": layers}
    ratio, half_node, area, at_cap = _equal_area(scene, block)
    error = half_node
    if coarse and math.isfinite(ratio):
        if any(n % 2 or n < 8 for n in scene.surface.shape):
            raise InvalidScene(
                f"the grid of {scene.surface.shape} points has no half; give even numbers of at "
                "least 8, or coarse=False"
            )
        error += abs(_equal_area(_half(scene), block)[0] - ratio)
    material = scene.material
    effective = material.young_modulus / (1 - material.poisson_ratio**2)
    severity = effective * _rms_slope(scene.surface) / material.yield_stress
    return EffectiveHardness(ratio, error, severity, area, at_cap)


def _equal_area(
    scene: Scene, block: dict[str, Any]
) -> tuple[float, float, float, Difference | None]:
    """(ratio, its change for half a node, area, the difference there), by bisection."""
    j2 = fem_check.solve(scene, law="j2", certified=False, **block)
    wanted = j2.final.areas["raw"].total
    compliance = fem_check.surface_compliance(scene, **block)
    yield_stress = scene.material.yield_stress

    def capped(ratio: float) -> ContactResult:
        material = replace(scene.material, hardness=ratio * yield_stress)
        return bem.solve(replace(scene, material=material), compliance=compliance)

    if capped(math.inf).final.areas["raw"].total >= wanted:
        return math.inf, 0.0, wanted, None
    # Under the least cap that bears the load every node touches.
    areas = {scene.load.final / yield_stress * 1.001: 1.0}
    high = 8.0
    while (found := capped(high).final.areas["raw"].total) >= wanted:
        areas[high] = found
        high *= 2
    areas[high] = found
    count = scene.surface.heights.size
    edges = []
    # The area jumps by nodes: the ratios between which it passes the wanted count, each way. The
    # area falls with the ratio, so the second search starts from all that the first one knows.
    for target in (wanted + 0.5 / count, wanted - 0.5 / count):
        a = max((r for r, area in areas.items() if area > target), default=min(areas))
        b = min((r for r, area in areas.items() if area <= target and r > a), default=high)
        while b - a > 1e-4 * b:
            middle = math.sqrt(a * b)
            areas[middle] = capped(middle).final.areas["raw"].total
            a, b = (middle, b) if areas[middle] > target else (a, middle)
        edges.append(math.sqrt(a * b))
    ratio = (edges[0] + edges[1]) / 2
    at_cap = difference(j2, capped(ratio), ratio * yield_stress)
    return ratio, abs(edges[1] - edges[0]) / 2, wanted, at_cap


def crosscheck(case: Case) -> str:
    """What makes the finite and the boundary elements of a case differ, surface by surface.

    The error budget of the case's finite-element law; for j2 also both contact areas, their
    overlap, the distance of the pressure distributions, and the effective hardness.

    Raises InvalidCase where a case has nothing to cross-check, and what the solvers raise.
    """
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
            "boundary elements know no other, so a cross-check could not tell slope from error"
        )
    lines = []
    for recipe in case.recipes:
        seed = getattr(recipe, "seed", None)
        lines.append(f"{case.id}, {case.size}" + ("" if seed is None else f", seed {seed}"))
        lines += [f"  {line}" for line in _checked(case.scene(recipe), options)]
    return "\n".join(lines)


def _checked(scene: Scene, options: Mapping[str, Any]) -> list[str]:
    """The lines on one surface."""
    block = {name: options.get(name) for name in ("depth", "layers")}
    law = options["law"]
    budget = error_budget(scene, law=law, report=None, **block)
    lines = [str(budget)]
    model = budget.model
    if model is not None:
        unit = "hardness" if math.isfinite(scene.material.hardness) else "mean contact pressure"
        cap = "capped" if math.isfinite(scene.material.hardness) else "elastic"
        lines.append(
            f"j2 touches on {model.areas[0]:.4f}, the {cap} body on {model.areas[1]:.4f} of the "
            f"nodes; overlap {model.overlap:.2f}; distance of the pressure distributions "
            f"{model.wasserstein:.3f} of the {unit}"
        )
        halved = all(n % 2 == 0 and n >= 8 for n in scene.surface.shape)
        found = effective_hardness(scene, coarse=halved, **block)
        lines.append(str(found) + ("" if halved else "; no coarser grid in the error"))
    return lines


def _require_one_load(scene: Scene) -> None:
    if len(scene.load.path) != 1:
        raise InvalidScene(
            f"the scene has a path of {len(scene.load.path)} mean pressures; give a single one"
        )


def _half(scene: Scene) -> Scene:
    """The scene on every other grid point."""
    heights = scene.surface.heights[(slice(None, None, 2),) * scene.surface.heights.ndim]
    return replace(
        scene,
        surface=Surface(heights, scene.surface.periods),
        load=Load(scene.load.final),
    )


def _rms_slope(surface: Surface) -> float:
    """Of the trigonometric interpolant of the heights."""
    spectrum = np.fft.fftn(surface.heights) / surface.heights.size
    square = np.zeros(surface.shape)
    for axis, (n, period) in enumerate(zip(surface.shape, surface.periods, strict=True)):
        q = 2 * np.pi * np.fft.fftfreq(n, period / n)
        square = square + (q**2).reshape([-1 if a == axis else 1 for a in range(square.ndim)])
    return float(np.sqrt(np.sum(square * np.abs(spectrum) ** 2)))
