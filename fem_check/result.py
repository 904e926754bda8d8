"""Turn finite-element states into a ContactResult: areas, pressures, fields, notes.

Areas.  `raw` counts nodes in contact.  The count overestimates the area: the rim is
inside the last node in contact, and elements as large as the waves they carry are
softer than the solid. Measured against Westergaard (lines) and periodic Hertz
(spheres), averaged over shifts of the grid (tests/test_fem_closed_forms.py), a straight
rim is

    rim(nu) = 0.25 + 0.21 nu          (+- 0.02)

spacings inside the count.  `corrected` subtracts this for every end of a contact on a
line, and pi/4 of it for every switch along rows and columns of a surface, because a rim
of any direction crosses 4/pi as many rows and columns as its length.  The front between
elastic and capped contact is corrected with the other sign.  `error` is a quarter of
the correction and, by chance, twice the root of a twelfth a switch (on surfaces, where
rows and columns count each end twice, a 24th): each end is rounded to a node, which is
most of the error of a few small spots.  Where a capped node is the neighbour of an open
one, the elastic rim is narrower than a spacing, and the cap on the counted nodes is the
load: neither front is corrected there, only doubted, as the correction would make the
area of rough surfaces with a hardness of 0.01 to 0.1 E* xi too small by 3 to 19 %.

Plastic area.  For the law "capped" it counts the nodes at the hardness; for "j2",
contact nodes at an element of the top layer that has ever flowed, less their share of
the contact's correction.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from epcontact.machine import peak_memory
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
from fem_check.path import PathPoint, SolvedPath

#: Pressures at which the distribution is tabulated.
_DISTRIBUTION_POINTS = 1025
#: Largest rms slope at which the gap geometry and small strains are trusted: at slope
#: 0.1 and E* xi/sigma_Y = 50, moving the nodes changed the load by 11 to 13 %.
LARGEST_SLOPE = 0.1
#: Fewest nodes across the median contact: below, a shift of the grid changes a sphere's
#: area by more than a quarter.
FEWEST_NODES = 4
#: Largest plastic strain at which small strains are trusted.
LARGEST_STRAIN = 0.2


def contact_result(path: SolvedPath) -> ContactResult:
    """The result of a solved path, with the certificate among the residuals of the last
    step.
    """
    problem, points, surface = path.problem, path.points, path.scene.surface
    block = problem.block
    fields = surface_fields(path, points[-1])
    contact = fields["pressure"], fields["state"]
    counts = sum((point.counts for point in points[1:]), points[0].counts)
    layers = {"layers": len(block.layers), "first_layer": float(block.layers[0])}
    options = asdict(path.options) | {"depth": block.depth, **layers}
    del options["approach"], options["certified"]
    return ContactResult(
        method="fem",
        steps=tuple(load_step(path, point) for point in points),
        provenance=Provenance(path.scene.digest, surface.seed, options),
        distribution=distribution(*contact, problem.cap / block.node_area),
        fields={name: values.reshape(surface.shape) for name, values in fields.items()},
        cost={
            "seconds": path.seconds,
            "newton_steps": counts.newton,
            "cg_iterations": counts.cg,
            "contact_sweeps": counts.sweeps,
            "increments": counts.increments,
            "most_newton_steps": counts.most_newton,
            "most_cg_iterations": counts.most_cg,
            "unknowns": 3
            * problem.heights.size
            * (len(block.layers) + int(block.sliding)),
            "peak_memory_bytes": float(peak_memory()),
        },
        history=points[-1].history,
        notes=(*surface.notes, *_warnings(path)),
    )


def surface_fields(path: SolvedPath, point: PathPoint) -> dict[str, NDArray[Any]]:
    """Fields (nx, ny) in SI units; plastic displacement is that of capped or unloaded
    bodies.
    """
    fields: dict[str, NDArray[Any]] = {
        "heights": path.scene.surface.heights,
        "pressure": np.maximum(point.state.forces, 0.0) / path.problem.block.node_area,
        "gap": point.gap,
        "displacement": _descent(path.scene, point),
        "state": point.surface_states,
    }
    if path.problem.capped:
        fields["plastic_displacement"] = point.plastic_displacement
    elif path.problem.plastic and not point.mean_pressure:
        fields["plastic_displacement"] = fields["displacement"]
    return fields


def _descent(scene: Scene, point: PathPoint) -> FloatArray:
    """(nx, ny) downward displacement of the top in m; of a half-space, less its mean.
    Under a punch it is that of what is now at the place of a node, as `Problem.turned`
    has it.
    """
    down: FloatArray = -point.state.displacement[0, ..., 2]
    return down - down.mean() if scene.body.kind == "half_space" else down


def load_step(path: SolvedPath, point: PathPoint) -> LoadStep:
    """Areas, residuals and further quantities of one point of the path."""
    scene, problem, counts = path.scene, path.problem, point.counts
    raw, corrected, error = areas(
        point.surface_states, scene.material.poisson_ratio, problem.capped
    )
    pressure, touching = (
        point.state.forces / problem.block.node_area,
        point.surface_states != APART,
    )
    # Without plastic flow, the work of the pressures is twice the energy.
    work = float((pressure * _descent(scene, point)).mean())
    energy = point.flow.get("stored_energy", work / 2)
    if "stored_energy" in point.flow and scene.body.kind == "half_space":
        # Without the uniform compression of the block.
        confined = problem.law.bulk + 4 / 3 * problem.law.shear
        energy -= point.mean_pressure**2 * problem.block.depth / (2 * confined)
    return LoadStep(
        point.mean_pressure,
        {"raw": raw, "corrected": corrected, "error": error},
        point.residuals | (path.certificate if point is path.points[-1] else {}),
        {
            "newton": counts.newton,
            "cg": counts.cg,
            "contact_sweeps": counts.sweeps,
            "increments": counts.increments,
            "line_searches": counts.line_searches,
        },
        {
            "mean_gap": float(
                np.maximum(point.gap + point.plastic_displacement, 0).mean()
            ),
            "mean_separation": float(point.gap.mean()),
            "approach": point.state.approach + float(problem.heights.max()),
            "largest_pressure": float(pressure.max()),
            "mean_contact_pressure": float(pressure[touching].mean())
            if touching.any()
            else 0.0,
            "elastic_energy": energy,
            **point.flow,
        },
    )


def areas(
    states: NDArray[np.int8], poisson_ratio: float, capped: bool
) -> tuple[Areas, Areas, Areas]:
    """The raw and corrected areas and their error, as the module's docstring defines
    them.
    """
    touching, plastic, elastic = states != APART, states == PLASTIC, states == ELASTIC
    total, flowing = float(touching.mean()), float(plastic.mean())
    line = states.shape[1] == 1
    rim = (0.25 + 0.21 * poisson_ratio) * (1.0 if line else math.pi / 4) / states.size
    ends, fronts = count_switches(touching), count_switches(plastic)
    outer, inner = rim * ends, rim * fronts
    # Each pair of an open and a capped node is a switch of both fronts.
    direct = (outer + inner - rim * count_switches(elastic)) / 2 if capped else 0.0
    right_total = max(0.0, total - (outer - direct))
    if capped:
        right_plastic = min(right_total, flowing + inner - direct)
    else:
        right_plastic = flowing * (right_total / total if total else 1.0)
        inner = flowing - right_plastic
    corrected = Areas(right_total, max(right_total - right_plastic, 0.0), right_plastic)
    outer, inner = (
        math.hypot(part / 4, 2 * math.sqrt(count / (12 if line else 24)) / states.size)
        for part, count in ((min(total, outer), ends), (inner, fronts))
    )
    return (
        Areas(total, total - flowing, flowing),
        corrected,
        Areas(outer, outer + inner, inner),
    )


def count_switches(inside: NDArray[np.bool_]) -> int:
    """Number of pairs of neighbours along rows and columns of which only one is
    inside.
    """
    return sum(
        int((inside != np.roll(inside, 1, axis)).sum())
        for axis in (0, 1)
        if inside.shape[axis] > 1
    )


def distribution(
    pressure: FloatArray, states: NDArray[np.int8], cap: float
) -> PressureDistribution:
    """The share of the area at each nodal pressure; nodes at a finite cap are plastic
    instead.
    """
    capped = bool(np.isfinite(cap))
    values = pressure[(pressure > 0) & ((states != PLASTIC) | (not capped))]
    top = cap if capped else float(values.max(initial=0.0)) or 1.0
    edges = np.linspace(0.0, top, _DISTRIBUTION_POINTS)
    cumulative = np.searchsorted(np.sort(values), edges, side="right") / pressure.size
    plastic = float((states == PLASTIC).mean()) if capped else 0.0
    return PressureDistribution(edges, cumulative, plastic)


def _warnings(path: SolvedPath) -> tuple[str, ...]:
    """Sentences on increments that were halved and on the limits of this method."""
    out = [
        f"an increment towards point {number} was halved {point.counts.halvings} times"
        for number, point in enumerate(path.points)
        if point.counts.halvings
    ]
    last, slope = path.points[-1], path.scene.surface.rms_slope
    if slope > LARGEST_SLOPE:
        out.append(
            f"the rms slope of {slope:.2g} is too large for small strains (more than "
            f"{LARGEST_SLOPE:g}); scale heights, pressure and strengths down together"
        )
    nodes = nodes_across(last.surface_states != APART)
    if nodes < FEWEST_NODES:
        out.append(
            f"the median contact is {nodes:.1f} nodes across, fewer than {FEWEST_NODES}: areas "
            "and pressures depend on the grid"
        )
    if last.flow.get("plastic_depth", 0.0) >= path.problem.block.depth * (1 - 1e-9):
        out.append("the plastic zone reaches the base; give a deeper block")
    strain = last.flow.get("largest_plastic_strain", 0.0)
    if strain > LARGEST_STRAIN:
        out.append(
            f"the plastic strain reaches {strain:.2g}, too much for small strains"
        )
    return tuple(out)


def nodes_across(touching: NDArray[np.bool_]) -> float:
    """Nodes across the contact in smaller ones than which half of all contact nodes
    are.  On a line (ny = 1) its width, on a surface the diameter of a disc of its area.
    Contacts join over corners and over the periodic edges.
    """
    if not touching.any():
        return 0.0
    number = np.arange(touching.size).reshape(touching.shape)
    pairs = []
    for shift in ((0, 1), (1, 0), (1, 1), (1, -1)):
        both = touching & np.roll(touching, shift, (0, 1))
        pairs.append([number[both], np.roll(number, shift, (0, 1))[both]])
    joined = np.concatenate(pairs, axis=1)
    graph = coo_matrix((np.ones(joined.shape[1]), joined), (number.size, number.size))
    labels = connected_components(graph, directed=False)[1]
    sizes = np.sort(np.bincount(labels[touching.ravel()]))
    median = sizes[np.searchsorted(np.cumsum(sizes), touching.sum() / 2)]
    return float(median if touching.shape[1] == 1 else 2 * math.sqrt(median / math.pi))
