"""Hints on a foreign solver that does not hold its gates.

What the solver reports is compared with what its pressures give, and the results of
known mistakes are compared with its own: a modulus, a load, a cap, heights or axes that
are commonly wrong.  Each mistake is made on purpose in the scene, which the boundary
elements solve.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact import bem
from epcontact.errors import EpcontactError
from epcontact.harness.verdict.judgement import CaseVerdict
from epcontact.peers.pressure_result import result_of_pressures
from epcontact.results import ContactResult, LoadStep
from epcontact.scene import Load, Scene

#: The most grid points of a scene that is solved with mistakes; each solve takes a
#: second at most on so many.
_MOST_POINTS = 2**18
#: A mistake is named only if its results are so many times closer than correct ones.
#: Results of an unrelated mistake can be eight times closer.
_TIMES_CLOSER = 10.0
#: The largest relative difference from the results of a mistake that is named.
_CLOSE = 0.05
#: Relative difference of a reported value that is mentioned.
_SAME = 1e-6
#: Quantities by which results are compared, beside the raw area.
_COMPARED = (
    "mean_gap",
    "mean_separation",
    "elastic_energy",
    "largest_pressure",
)
_Fields = dict[str, NDArray[Any]]


def with_hints(case: CaseVerdict) -> CaseVerdict:
    """Return a verdict with hints on what is probably wrong with a foreign solver.

    There are none for a case that holds, and none for methods of the package.

    Args:
        case: the verdict on the case, with the results in memory.
    """
    if case.status == "holds":
        return case
    sentences: list[str] = []
    for name, method in case.results.items():
        for result in method.results[:1]:
            if not result.is_foreign:
                continue
            sentences += [f"{name} {words}" for words in _differing_reports(result)]
            scene = case.case.scene(case.case.recipes[0])
            words = _nearest_mistake(scene, result)
            if words:
                sentences.append(f"hint: {name} {words}")
    return case.model_copy(update={"hints": sentences})


def _differing_reports(result: ContactResult) -> Iterator[str]:
    """Yield a phrase for each value that a solver reports otherwise than its fields."""
    values = dict(result.final.quantities)
    for part, area in vars(result.final.areas["raw"]).items():
        values[f"{part}_area"] = area
    for name, reported in result.final.quantities.items():
        computed = values.get(name.removeprefix("reported_"))
        is_error = "_error" in name
        if not name.startswith("reported_") or computed is None or is_error:
            continue
        if not math.isclose(reported, computed, rel_tol=_SAME, abs_tol=_SAME**2):
            words = name.replace("_", " ").removeprefix("reported ")
            yield f"reports {words} {reported:.6g}, but its fields have {computed:.6g}"


# --- known mistakes


@dataclass(frozen=True)
class _Mistake:
    """A mistake that solvers are known to make.

    Attributes:
        words: what it is, after "as with".
        scene: the scene that the solver then solves.
        in_columns: whether it writes its pressures with x and y exchanged.
    """

    words: str
    scene: Scene
    in_columns: bool = False


def _mistakes(scene: Scene) -> Iterator[_Mistake]:
    """Yield the known mistakes that change a scene or its results."""
    material, surface, load = scene.material, scene.surface, scene.load.final
    nu = material.poisson_ratio

    def with_modulus(factor: float) -> Scene:
        """Return the scene with its Young's modulus multiplied by a factor."""
        modulus = material.young_modulus * factor
        return replace(scene, material=replace(material, young_modulus=modulus))

    if nu:
        yield _Mistake("E in the place of E* = E / (1 - nu^2)", with_modulus(1 - nu**2))
        yield _Mistake("1 - nu in the place of 1 - nu^2", with_modulus(1 + nu))
    yield _Mistake("half of E*, that of two equal bodies", with_modulus(0.5))
    yield _Mistake("twice E*", with_modulus(2.0))
    yield _Mistake("half of the load", replace(scene, load=Load(load / 2)))
    if 2 * load < material.hardness:
        yield _Mistake("twice the load", replace(scene, load=Load(2 * load)))
    flipped = replace(surface, heights=-surface.heights)
    yield _Mistake("heights of the other sign", replace(scene, surface=flipped))
    if math.isfinite(material.hardness):
        elastic = replace(material, hardness=math.inf)
        yield _Mistake("no hardness", replace(scene, material=elastic))
    if len(surface.shape) == 2:
        yield _Mistake("x and y exchanged in its results", scene, in_columns=True)
    longer = tuple(
        length * points / (points - 1)
        for length, points in zip(surface.periods, surface.shape, strict=True)
    )
    yield _Mistake(
        "the period divided by one point too few, n - 1",
        replace(scene, surface=replace(surface, periods=longer)),
    )


def _nearest_mistake(scene: Scene, result: ContactResult) -> str:
    """Return the known mistake whose results are nearest to those of a solver, in
    words.

    It is "" if no mistake is much nearer than the correct results, or if the scene is
    too large.  Of a path of loads, the last one before the first unloading is compared:
    until then earlier loads do not matter.

    Args:
        scene: the scene that the solver was given.
        result: the result of the solver.
    """
    if scene.surface.heights.size > _MOST_POINTS:
        return ""
    path = scene.load.path
    index = 0
    while index + 1 < len(path) and path[index + 1] >= path[index]:
        index += 1
    step = result.steps[index]
    scene = replace(scene, load=Load(path[index]))
    correct = _distance(step, scene, _Mistake("", scene))
    nearest = ""
    least = min(_CLOSE, correct / _TIMES_CLOSER)
    for mistake in _mistakes(scene):
        distance = _distance(step, scene, mistake)
        if distance < least:
            least = distance
            nearest = mistake.words
    if not nearest:
        return ""
    return (
        f"differs by {100 * least:.2g} % from results with {nearest}, and by "
        f"{100 * correct:.2g} % from correct ones"
    )


def _distance(step: LoadStep, scene: Scene, mistake: _Mistake) -> float:
    """Return how far the result of a solver at a load is from that of a mistake.

    It is the root mean square of the relative differences of the raw area and of
    quantities; infinite if the mistake cannot be solved.  The solver may have given its
    gap or not, so that the smaller of both distances is returned.

    Args:
        step: the result of the solver at the load.
        scene: the scene that it was given, with this load alone.
        mistake: the mistake.
    """
    try:
        fields: _Fields = dict(bem.solve(mistake.scene, tolerance=1e-6).fields)
    except EpcontactError:
        return math.inf
    names: tuple[str, ...] = ("pressure", "gap", "displacement")
    given = {name: fields[name] for name in names}
    if mistake.in_columns:
        for name, field in given.items():
            given[name] = field.ravel().reshape(field.shape, order="F")
    distances = [math.inf]
    for subset in (names, ("pressure",)):
        try:
            mistaken = result_of_pressures(
                scene, {name: given[name] for name in subset}, "mistake"
            )
        except EpcontactError:
            continue
        distances.append(_difference(_values(step), _values(mistaken.final)))
    return min(distances)


def _values(step: LoadStep) -> dict[str, float]:
    """Return the raw area and the compared quantities at a load by their names."""
    quantities = step.quantities
    values = {name: quantities[name] for name in _COMPARED if name in quantities}
    return values | {"area": step.areas["raw"].total}


def _difference(first: dict[str, float], second: dict[str, float]) -> float:
    """Return the root mean square of the relative differences of two sets of values.

    A value is compared if both have it.  Differences are relative to the larger one.
    """
    differences = []
    for name in first.keys() & second.keys():
        larger = max(abs(first[name]), abs(second[name]))
        differences.append((first[name] - second[name]) / larger if larger else 0.0)
    return float(np.sqrt(np.mean(np.square(differences))))
