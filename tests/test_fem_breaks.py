"""What breaks, and what mends it: each cure of the method is shown to be needed."""

from __future__ import annotations

import numpy as np
import pytest
from fem_scenes import rough_scene
from fem_spheres import sphere, sphere_scene

from epcontact.errors import NotConverged
from epcontact.results import APART
from fem_check import plasticity, solve
from fem_check.benchmarks.limit_loads import strip_punch
from fem_check.driver import problem_of
from fem_check.newton import NewtonOptions, solve_increment
from fem_check.problem import Control, State
from fem_check.result import nodes_across

#: The load at which a sphere of R = 1, E* = 1/(1 - 0.3^2) has Hertz's radius 0.05.
HERTZ = 4 / 3 / (1 - 0.3**2) * 0.05**3


def test_elements_without_mean_dilatation_lock() -> None:
    """Their load under a strip punch overshoots and keeps climbing; B-bar stands on a plateau.

    No scene has a limit load under a given pressure, so Prandtl's plateau is the element's gate.
    """
    locked = strip_punch(4, mean_dilatation=False)
    free = strip_punch(4)
    assert locked.computed[-1] / locked.exact[-1] > 1.3
    # 1.077 at four elements a half-width, 1.040 at eight: first order.
    assert free.computed[-1] / free.exact[-1] < 1.09
    assert locked.computed[-1] / locked.computed[-2] > 1.02
    assert free.computed[-1] / free.computed[-2] < 1.001


def cold_start(scene, options: NewtonOptions):  # type: ignore[no-untyped-def]
    """One step from the virgin body out of contact, all nodes taken for touching."""
    problem = problem_of(scene, law="j2")
    nx, ny = problem.block.shape
    everywhere = np.ones((nx, ny), dtype=np.int8)
    start = State(np.zeros(problem.block.field_shape), 0.0, everywhere, np.zeros((nx, ny)))
    load = scene.load.final
    history = plasticity.initial_history(problem.bricks.number)
    return solve_increment(problem, start, history, Control(load, scale=load), options)


def test_an_unglobalised_merged_newton_diverges_where_the_nested_one_does_not() -> None:
    """One change of the contact set an iteration, full steps, pure tangent, cold start."""
    scene = rough_scene(12, 2, yield_stress=0.02, pressure=0.01, hardness=np.inf)
    naive = NewtonOptions(line_search=False, regularise=False, sweeps=1, max_newton=12)
    with pytest.raises(NotConverged) as caught:
        cold_start(scene, naive)
    # It does not merely run out of iterations: it is nowhere near.
    assert min(caught.value.history[-5:]) > 1e-3
    solved = cold_start(scene, NewtonOptions(max_newton=12))
    assert max(solved.residuals.values()) < 1e-8


def test_too_few_nodes_across_a_contact_mislead() -> None:
    """Where the grid lies must not matter: with under 2 nodes to the rim it changes a sphere's
    area by more than a quarter, with 10 by less than a fiftieth; only the first is warned of."""
    spread = {}
    for rim in (1.5, 10.0):
        found = []
        for offset in ((0.0, 0.0), (0.25, 0.5), (0.5, 0.5), (0.1, 0.3)):
            scene = sphere_scene(
                HERTZ, nodes=48, nodes_to_rim=rim, poisson_ratio=0.3, yield_stress=1.0,
                offset=offset,
            )  # fmt: skip
            result = solve(scene, law="elastic", certified=False)
            found.append(result.final.areas["raw"].total)
            assert any("nodes across" in note for note in result.notes) == (rim < 2)
        spread[rim] = (max(found) - min(found)) / np.mean(found)
    assert spread[1.5] > 0.25
    assert spread[10.0] < 0.02


def test_the_nodes_across_a_contact_are_counted_over_the_periodic_edges() -> None:
    state = np.full((12, 12), APART)
    state[-2:, -2:] = state[:2, -2:] = state[-2:, :2] = state[:2, :2] = 1
    assert nodes_across(state != APART) == pytest.approx(2 * np.sqrt(16 / np.pi))
    state[6, 6] = 1  # a lone node does not move the median
    assert nodes_across(state != APART) == pytest.approx(2 * np.sqrt(16 / np.pi))
    line = np.zeros((10, 1), dtype=bool)
    line[[9, 0, 1]] = True
    assert nodes_across(line) == 3


def test_a_fully_plastic_sphere_does_not_stall() -> None:
    """E* a/(sigma_Y R) = 40, where the pure tangent leaves the contact next to no stiffness."""
    answer = sphere(40.0, nodes=32, nodes_to_rim=6.0)
    assert 2.6 < answer.mean_pressure < 2.9
    assert answer.newton_steps <= 10 * 4
