"""What the finite elements cost: a whole load path, and one linear solve beside the alternatives.

`path_cost` runs the J2 load path of a rough scene and reports seconds beside the seconds of a
bare 2048 x 2048 real FFT pair on the same core, which is the unit that travels between machines.
`linear_costs` takes the tangent in the middle of such a path, on its contact set at a given
approach, and solves it by this package's preconditioned conjugate gradients, by Jacobi-
preconditioned ones, by a sparse direct solver (SuperLU) and, where pyamg is installed, by
smoothed aggregation with its default near-null space.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import ducc0
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import cg, splu

from epcontact.errors import NotConverged
from epcontact.results import ELASTIC, FloatArray
from epcontact.scene import Load, Material, Scene, Surface
from fem_check import linearised, plasticity
from fem_check.benchmarks.bodies import assembled, elastic_tangents, tangents
from fem_check.driver import solve, solve_path
from fem_check.element import strain_operator
from fem_check.linear_solver import factorise
from fem_check.problem import Control, Counts, Problem, State, internal_force

#: Largest number of unknowns that each alternative is given: beyond, it needs minutes.
LIMITS = {"superlu": 20_000, "jacobi": 2_000_000, "smoothed aggregation": 500_000}


@dataclass(frozen=True)
class PathCost:
    """A load path: its size, seconds, iterations, and seconds over those of an FFT pair."""

    unknowns: int
    seconds: float
    fft_pairs: float
    newton_steps: int
    most_newton_steps: int
    cg_iterations: int
    peak_memory_bytes: float


@dataclass(frozen=True)
class LinearCost:
    """One linear solve to a relative residual of 1e-8: seconds to set up and to solve, and
    iterations (0: direct)."""

    solver: str
    unknowns: int
    setup_seconds: float
    solve_seconds: float
    iterations: int


def fft_pair_seconds(size: int = 2048, repeats: int = 3) -> float:
    """Seconds of a bare real FFT pair on one core: the fastest of `repeats`."""
    field, best = np.random.default_rng(3).random((size, size)), np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        spectrum = ducc0.fft.r2c(field, nthreads=1)
        ducc0.fft.c2r(spectrum, lastsize=size, forward=False, inorm=2, nthreads=1)
        best = min(best, time.perf_counter() - begin)
    return best


def speed_scene(nodes: int, *, line: bool = False, load: float = 0.05, seed: int = 5) -> Scene:
    """A self-affine scene with eight (a line: 16) nodes to its shortest wave, E* xi = 1 at slope
    0.05, sigma_Y = 0.2, nu = 0.3, under the mean pressure `load`."""
    highest = nodes // (16 if line else 8)
    frequency = np.abs(np.fft.fftfreq(nodes, 1 / nodes))
    q = frequency if line else np.hypot(frequency[:, None], frequency[None, :])
    inside = (q > 0) & (q <= highest)
    power = np.where(inside, np.where(inside, q, 1.0) ** (-1.3 if line else -1.8), 0.0)
    noise = np.random.default_rng(seed).standard_normal(q.shape)
    heights = np.fft.ifftn(power * np.fft.fftn(noise)).real
    spectrum = np.abs(np.fft.fftn(heights)) / heights.size
    slope = np.sqrt(np.sum((2 * np.pi * q * spectrum) ** 2))
    return Scene(
        Surface(heights * 0.05 / slope, (1.0,) * heights.ndim, seed=seed),
        Material((1 - 0.3**2) / 0.05, 0.3, yield_stress=0.2),
        Load(load),
    )


def path_cost(
    nodes: int,
    layers: int,
    *,
    line: bool = False,
    steps: int = 4,
    seed: int = 5,
    fft_pair: float | None = None,
) -> PathCost:
    """The J2 path of `speed_scene`, after a small one that compiles the loops; `fft_pair`: its
    seconds, timed anew where not given."""
    solve(speed_scene(16, line=line))
    begin = time.perf_counter()
    scene = speed_scene(nodes, line=line, seed=seed)
    result = solve(scene, layers=layers, steps=steps, certified=False)
    seconds = time.perf_counter() - begin
    cost = result.cost
    return PathCost(
        int(cost["unknowns"]),
        seconds,
        seconds / (fft_pair_seconds() if fft_pair is None else fft_pair),
        int(cost["newton_steps"]),
        int(cost["most_newton_steps"]),
        int(cost["cg_iterations"]),
        cost["peak_memory_bytes"],
    )


def linear_costs(
    nodes: int, layers: int, solvers: Sequence[str] = ("fft", "jacobi", "superlu")
) -> list[LinearCost]:
    """One linear solve of the same tangent and right-hand side by each of `solvers`: fft,
    jacobi, superlu, smoothed aggregation.  A solver beyond its limit is left out."""
    unknowns = 3 * nodes**2 * layers
    wanted = [s for s in solvers if unknowns <= LIMITS.get(s, unknowns)]
    if not wanted:
        return []
    problem, state, softening = _middle(nodes, layers)
    right = np.random.default_rng(9).standard_normal(problem.block.field_shape)
    right[-1] = 0
    right[0, ..., 2][state.states == ELASTIC] = 0
    out = []
    if "fft" in wanted:
        out.append(_by_fft(problem, state, softening, right, unknowns))
    if set(wanted) - {"fft"}:
        K, keep = _matrix(problem, state, softening)
        out += [_by_matrix(s, K, right.ravel()[keep], unknowns) for s in wanted if s != "fft"]
    return out


def _middle(nodes: int, layers: int) -> tuple[Problem, State, plasticity.Softening]:
    """Half-way through the last increment: its start's history, its end's displacement."""
    before = solve_path(speed_scene(nodes, load=0.0375), layers=layers, steps=3, certified=False)
    after = solve_path(speed_scene(nodes, load=0.05), layers=layers, steps=4, certified=False)
    problem, state = after.problem, after.reached[-1].state
    u = state.displacement
    _, yielded = internal_force(problem, u, before.history)
    softening = plasticity.linearise(
        u.reshape(-1, 3), problem.bricks, problem.law, before.history, yielded
    )
    return problem, state, softening


def _by_fft(
    problem: Problem,
    state: State,
    softening: plasticity.Softening,
    right: FloatArray,
    unknowns: int,
) -> LinearCost:
    begin = time.perf_counter()
    factorise(problem.block, problem.bricks, problem.law)
    setup = time.perf_counter() - begin
    counts, begin = Counts(), time.perf_counter()
    linearised.solve_linear(problem, state, softening, right, Control(approach=state.approach),
                        1e-8 * float(np.linalg.norm(right)), counts)  # fmt: skip
    return LinearCost("fft", unknowns, setup, time.perf_counter() - begin, counts.cg)


def _matrix(
    problem: Problem, state: State, softening: plasticity.Softening
) -> tuple[sp.csr_matrix, np.ndarray]:
    """The tangent without the held base and without the normal motion of the contact nodes, and
    which degrees of freedom it has."""
    bricks, size = problem.bricks, 3 * problem.heights.size
    strain = np.stack([strain_operator(bricks, s) for s in range(len(bricks.gradients))])
    elastic = elastic_tangents(bricks, problem.law, strain)
    nodes = int(np.prod(problem.block.field_shape[:3]))
    K = assembled(bricks, tangents(bricks, elastic, strain, softening, 0.0), nodes)
    keep = np.ones(3 * nodes, dtype=bool)
    keep[-size:] = False
    keep[2:size:3] = (state.states != ELASTIC).ravel()
    return K[keep][:, keep].tocsr(), keep


def _by_matrix(solver: str, K: sp.csr_matrix, b: FloatArray, unknowns: int) -> LinearCost:
    begin, iterations = time.perf_counter(), 0

    def count(_: FloatArray) -> None:
        nonlocal iterations
        iterations += 1

    if solver == "superlu":
        factor = splu(K.tocsc(), options={"SymmetricMode": True}, permc_spec="MMD_AT_PLUS_A",
                      diag_pivot_thresh=0.0)  # fmt: skip
        setup, begin = time.perf_counter() - begin, time.perf_counter()
        factor.solve(b)
        return LinearCost(solver, unknowns, setup, time.perf_counter() - begin, 0)
    if solver == "jacobi":
        M = sp.diags(1 / K.diagonal())
    elif solver == "smoothed aggregation":
        import pyamg  # type: ignore[import-not-found, import-untyped, unused-ignore]

        M = pyamg.smoothed_aggregation_solver(K.tobsr((1, 1))).aspreconditioner()
    else:
        raise ValueError(f"solver is {solver!r}, but must be fft, {', '.join(LIMITS)}")
    setup, begin = time.perf_counter() - begin, time.perf_counter()
    _, failed = cg(K, b, rtol=1e-8, maxiter=5000, M=M, callback=count)
    if failed:
        raise NotConverged(f"{solver} did not reach 1e-8 in {iterations} iterations")
    return LinearCost(solver, unknowns, setup, time.perf_counter() - begin, iterations)
