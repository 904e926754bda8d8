"""The estimate of a solve's memory against the arrays that it makes."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import pytest

import fem_check
from epcontact.scene import Body, Load, Scene
from fem_check.benchmarks.speed import speed_scene
from fem_check.driver import problem_of
from fem_check.memory import bytes_needed, flowing_shares


def scene(nodes: int, load: float = 0.05, yield_stress: float = 0.2, depth: float = 0.0) -> Scene:
    plain = speed_scene(nodes, load=load)
    material = replace(plain.material, yield_stress=yield_stress)
    body = Body("bonded_layer", depth) if depth else Body()
    return Scene(plain.surface, material, Load(load), body)


# A twentieth of the elements flow, or a third, or all of them, or none may.
@pytest.mark.parametrize(
    ("given", "options"),
    [
        (scene(16), {"law": "elastic"}),
        (scene(16), {"steps": 2, "certified": True}),
        (scene(16), {}),
        (scene(32), {"steps": 2, "layers": 24}),
        (scene(16), {"steps": 2, "geometry": "moved"}),
        (scene(16, 0.1), {"steps": 2}),
        (scene(24, 0.3), {"steps": 2}),
        (scene(24, 0.005, 0.02), {"steps": 2}),
        (scene(16, 0.08, 0.02, 0.3), {"steps": 2}),
        (scene(16, depth=0.4), {"steps": 2}),
    ],
)
def test_the_estimate_of_memory_is_right_to_a_quarter(
    given: Scene, options: dict[str, Any]
) -> None:
    options = {"law": "j2", "certified": False} | options
    fem_check.solve(scene(8), **options)  # compiles the same kernels, which needs memory, too
    tracemalloc.start()
    try:
        fem_check.solve(given, **options)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    geometry = options.get("geometry", "gap")
    block = problem_of(given, geometry=geometry, layers=options.get("layers")).block
    limit = given.material.yield_stress
    flow = flowing_shares(block, given.load.final, limit, 1 / limit)
    needed = bytes_needed(
        block, flow=None if options["law"] == "elastic" else flow, certified=options["certified"]
    )
    assert 0.75 < needed / peak < 1.25
