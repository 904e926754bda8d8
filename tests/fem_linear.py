"""The linear system in the middle of a load path, and its matrix."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from epcontact.results import ELASTIC
from fem_check import plasticity, solve_path
from fem_check.benchmarks.limit_loads import elastic_tangents, sparse_matrix, tangents
from fem_check.benchmarks.speed import speed_scene
from fem_check.element import strain_operator
from fem_check.linearised import Tangent, linear_contact
from fem_check.plasticity import TangentCorrection
from fem_check.problem import Control, Problem, State, internal_force


def middle_of_a_path(nodes: int, layers: int) -> tuple[Problem, State, TangentCorrection]:
    """Half-way through the last increment: its start's history, its end's displacement."""
    before = solve_path(speed_scene(nodes, load=0.0375), layers=layers, steps=3, certified=False)
    after = solve_path(speed_scene(nodes, load=0.05), layers=layers, steps=4, certified=False)
    problem, state = after.problem, after.points[-1].state
    return problem, state, correction_at(problem, state.displacement, before.history)


def correction_at(problem, u, history) -> TangentCorrection:  # type: ignore[no-untyped-def]
    """The tangent's correction at the displacement `u` that starts from `history`."""
    _, flowing = internal_force(problem, u, history)
    return plasticity.tangent_correction(
        u.reshape(-1, 3), problem.bricks, problem.law, history, flowing
    )


def random_force(problem: Problem, state: State, seed: int) -> np.ndarray:
    """Random nodal forces where the base and the contact hold nothing."""
    right = np.random.default_rng(seed).standard_normal(problem.block.field_shape)
    right[-1] = 0
    right[0, ..., 2][state.states == ELASTIC] = 0
    return right


def solve_on_the_contact(  # type: ignore[no-untyped-def]
    problem, state, correction, right, reduction
):
    """The step under the forces `right` on the contact set of `state`, and the CG iterations."""
    # One change of the set at most, after the solve; its goal is five times the forcing.
    linear, counts = linear_contact(
        state, right, Tangent(problem, correction), Control(approach=state.approach),
        forcing=reduction / 5, sweeps=1,
    )  # fmt: skip
    return linear.step, counts.cg


def whole_matrix(problem: Problem, correction: TangentCorrection, blend: float) -> sp.csr_matrix:
    """The assembled tangent of all nodes, with a share `blend` of the elastic stiffness."""
    bricks = problem.bricks
    strain = np.stack([strain_operator(bricks, s) for s in range(len(bricks.gradients))])
    elastic = elastic_tangents(bricks, problem.law, strain)
    nodes = int(np.prod(problem.block.field_shape[:3]))
    return sparse_matrix(bricks, tangents(bricks, elastic, strain, correction, blend), nodes)


def contact_matrix(
    problem: Problem, state: State, correction: TangentCorrection
) -> tuple[sp.csr_matrix, np.ndarray]:
    """The tangent without the held base and without the normal motion of the contact nodes, and
    which degrees of freedom it has."""
    K, size = whole_matrix(problem, correction, 0.0), 3 * problem.heights.size
    keep = np.ones(K.shape[0], dtype=bool)
    keep[-size:] = False
    keep[2:size:3] = (state.states != ELASTIC).ravel()
    return K[keep][:, keep].tocsr(), keep
