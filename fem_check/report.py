"""From finite-element states to a ContactResult: areas, pressures, fields, notes.

Areas.  raw counts nodes in contact.  Counting overestimates: the rim lies inside the last node it
took, and elements as large as the waves they carry are softer than the solid, so contacts grow
beyond where they should end.  Both are a fixed share of a spacing.  Measured with these elements
against Westergaard (lines) and periodic Hertz (spheres), averaged over shifts of the grid
(tests/test_fem_elastic.py), a straight rim lies

    rim(nu) = 0.25 + 0.21 nu          (+- 0.02)

spacings inside the count.  `corrected` takes that off for every end of a contact on a line and
pi/4 of it (a rim of any direction crosses 4/pi as many rows and columns as its length) for every
switch along rows and columns of a surface; the front between elastic and capped contact is
treated alike with the other sign.  `error` is a quarter of what was taken off.

Plastic area.  capped: nodes at the hardness.  j2: contact nodes that touch an element of the top
layer in which some Gauss point has flowed, now or earlier.  It says where the surface has
yielded; a contact that flows below the surface alone does not count.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    Areas,
    ContactResult,
    FloatArray,
    LoadStep,
    PressureDistribution,
    Provenance,
)
from epcontact.scene import Scene
from fem_check.problem import Problem

if TYPE_CHECKING:
    from fem_check.driver import SolvedPath
    from fem_check.path import Reached

_DISTRIBUTION_POINTS = 1025
#: Largest rms slope at which the gap geometry and small strains are trusted: at slope 0.1 and
#: E* xi/sigma_Y = 50, moving the nodes changed the load by 11 to 13 %.
LARGEST_SLOPE = 0.1
FEWEST_NODES = 4
LARGEST_STRAIN = 0.2


def contact_result(path: SolvedPath, memory: float) -> ContactResult:
    """The result of a solved path; its certificate joins the residuals of the last step."""
    problem, last = path.problem, path.reached[-1]
    steps = [load_step(path.scene, problem, reached) for reached in path.reached]
    steps[-1].residuals.update(path.certificate)  # type: ignore[attr-defined]
    shape = path.scene.surface.shape
    fields = surface_fields(path.scene, problem, last)
    counts = [reached.counts for reached in path.reached]
    cost = {
        "seconds": path.seconds,
        "newton_steps": sum(c.newton for c in counts),
        "cg_iterations": sum(c.cg for c in counts),
        "contact_sweeps": sum(c.sweeps for c in counts),
        "increments": sum(c.increments for c in counts),
        "most_newton_steps": max(c.largest_newton for c in counts),
        "most_cg_iterations": max(c.largest_cg for c in counts),
        "unknowns": 3
        * problem.heights.size
        * (len(problem.block.layers) + (1 if problem.block.sliding else 0)),
        "peak_memory_bytes": memory,
    }
    return ContactResult(
        method="fem",
        steps=tuple(steps),
        provenance=Provenance(path.scene.digest, path.scene.surface.seed, path.options),
        distribution=distribution(
            fields["pressure"],
            fields["state"],
            problem.cap / problem.block.node_area if np.isfinite(problem.cap) else math.inf,
        ),
        fields={name: values.reshape(shape) for name, values in fields.items()},
        cost=cost,
        history=tuple(last.counts.history),
        notes=(*path.scene.surface.notes, *path.notes, *warnings(path)),
    )


def surface_fields(scene: Scene, problem: Problem, reached: Reached) -> dict[str, NDArray[Any]]:
    """heights, pressure, gap, displacement and state on the scene's grid."""
    state = reached.state
    down = -state.displacement[0, ..., 2]
    gap = down - problem.heights - state.approach
    gap[state.states == ELASTIC] = 0.0
    kept = down - down.mean() if scene.body.kind == "half_space" else down
    return {
        "heights": scene.surface.heights,
        "pressure": np.maximum(state.forces, 0.0) / problem.block.node_area,
        "gap": gap,
        "displacement": kept,
        "state": reached.surface_states,
    }


def load_step(scene: Scene, problem: Problem, reached: Reached) -> LoadStep:
    """Areas, residuals and further quantities of one point of the path."""
    state, states = reached.state, reached.surface_states
    raw, corrected, error = areas(
        states, scene.material.poisson_ratio, bool(np.isfinite(problem.cap))
    )
    down = -state.displacement[0, ..., 2]
    gap = down - problem.heights - state.approach
    pressure = state.forces / problem.block.node_area
    touching = states != APART
    if scene.body.kind == "half_space":
        down = down - down.mean()
    return LoadStep(
        reached.mean_pressure,
        {"raw": raw, "corrected": corrected, "error": error},
        dict(reached.residuals),
        {
            "newton": reached.counts.newton,
            "cg": reached.counts.cg,
            "contact_sweeps": reached.counts.sweeps,
            "increments": reached.counts.increments,
            "line_searches": reached.counts.cuts,
        },
        {
            "mean_gap": float(np.maximum(gap, 0).mean()),
            "mean_separation": float(gap.mean()),
            "approach": state.approach + float(problem.heights.max()),
            "largest_pressure": float(pressure.max()),
            "mean_contact_pressure": float(pressure[touching].mean()) if touching.any() else 0.0,
            "elastic_energy": float((pressure * down).mean()) / 2,
            **reached.measures,
        },
    )


def areas(
    states: NDArray[np.int8], poisson_ratio: float, capped: bool
) -> tuple[Areas, Areas, Areas]:
    """(raw, corrected, error) of (nx, ny) states; see the module."""
    count = states.size
    touching, plastic = states != APART, states == PLASTIC
    total, flowing = float(touching.mean()), float(plastic.mean())
    rim = (0.25 + 0.21 * poisson_ratio) * (1.0 if states.shape[1] == 1 else math.pi / 4) / count
    less = min(total, rim * _switches(touching))
    if capped:
        more = rim * _switches(plastic)
        right_total = total - less
        right_plastic = min(right_total, flowing + more)
    else:
        more = 0.0
        right_total = total - less
        right_plastic = flowing * (right_total / total if total else 1.0)
    raw = Areas(total, total - flowing, flowing)
    corrected = Areas(right_total, right_total - right_plastic, right_plastic)
    return raw, corrected, Areas(less / 4, (less + more) / 4, more / 4)


def _switches(inside: NDArray[np.bool_]) -> int:
    return sum(
        int((inside != np.roll(inside, 1, axis)).sum()) for axis in (0, 1) if inside.shape[axis] > 1
    )


def distribution(
    pressure: FloatArray, states: NDArray[np.int8], cap: float
) -> PressureDistribution:
    """How the area is shared out over the nodal pressures.  With a cap, nodes at it are the
    plastic fraction; J2 knows no single plastic pressure, so all its contact is tabulated."""
    values = pressure[pressure > 0]
    if np.isfinite(cap):
        values = pressure[(pressure > 0) & (states != PLASTIC)]
    top = cap if np.isfinite(cap) else float(values.max(initial=0.0)) or 1.0
    edges = np.linspace(0.0, top, _DISTRIBUTION_POINTS)
    cumulative = np.searchsorted(np.sort(values), edges, side="right") / pressure.size
    plastic = float((states == PLASTIC).mean()) if np.isfinite(cap) else 0.0
    return PressureDistribution(edges, cumulative, plastic)


def yielded_surface(problem: Problem, accumulated: FloatArray) -> NDArray[np.bool_]:
    """(nx, ny) top nodes that touch an element of the top layer which has flowed."""
    nx, ny = problem.block.shape
    flowed = (accumulated[: nx * ny] > 0).any(axis=1).reshape(nx, ny)
    around = flowed | np.roll(flowed, 1, 0)
    return np.asarray(around | np.roll(around, 1, 1))


def warnings(path: SolvedPath) -> tuple[str, ...]:
    """What a reader must know: where the scene is outside what this check can answer."""
    out = []
    block, heights = path.problem.block, path.problem.heights
    slope = rms_slope(heights, block.spacing)
    if slope > LARGEST_SLOPE:
        out.append(
            f"the rms slope of {slope:.2g} is too large for small strains (more than "
            f"{LARGEST_SLOPE:g}); scale heights, pressure and strengths down together"
        )
    nodes = nodes_across(path.reached[-1].surface_states != APART)
    if nodes < FEWEST_NODES:
        out.append(
            f"the median contact is {nodes:.1f} nodes across, fewer than {FEWEST_NODES}: areas "
            "and pressures are those of the grid"
        )
    measures = path.reached[-1].measures
    if measures.get("plastic_depth", 0.0) >= block.depth * (1 - 1e-9):
        out.append("the plastic zone reaches the base; give a deeper block")
    if measures.get("largest_plastic_strain", 0.0) > LARGEST_STRAIN:
        out.append(
            f"the plastic strain reaches {measures['largest_plastic_strain']:.2g}, too much "
            "for small strains"
        )
    return tuple(out)


def rms_slope(heights: FloatArray, spacing: tuple[float, float]) -> float:
    """Root mean square of the gradient, by differences of neighbours."""
    total = 0.0
    for axis, step in enumerate(spacing):
        if heights.shape[axis] > 1:
            total += float(np.mean(((heights - np.roll(heights, 1, axis)) / step) ** 2))
    return math.sqrt(total)


def nodes_across(touching: NDArray[np.bool_]) -> float:
    """How many nodes the median contact is across: that patch in which half of the contact
    nodes lie in smaller ones; on a surface the diameter of the disc of the same area."""
    from scipy import ndimage

    if not touching.any():
        return 0.0
    labels, count = ndimage.label(touching, structure=np.ones((3, 3)))
    labels = _joined(labels, count)
    sizes = np.sort(np.bincount(labels[touching]))
    sizes = sizes[sizes > 0]
    median = sizes[np.searchsorted(np.cumsum(sizes), touching.sum() / 2)]
    return float(median if touching.shape[1] == 1 else 2 * math.sqrt(median / math.pi))


def _joined(labels: NDArray[Any], count: int) -> NDArray[np.int32]:
    """Labels with those joined that meet over the periodic edges."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = [
        np.stack([first.ravel(), second.ravel()])
        for first, second in (
            *((labels[-1], np.roll(labels[0], s)) for s in (-1, 0, 1)),
            *((labels[:, -1], np.roll(labels[:, 0], s)) for s in (-1, 0, 1)),
        )
    ]
    both = np.concatenate(pairs, axis=1)
    both = both[:, (both > 0).all(axis=0)]
    graph = coo_matrix((np.ones(both.shape[1]), (both[0], both[1])), shape=(count + 1,) * 2)
    merged = connected_components(graph, directed=False)[1]
    return np.asarray(merged[labels] + 1, dtype=np.int32)
