"""Turn finite-element states into a ContactResult: areas, pressures, fields, notes.

Areas.  `raw` counts nodes in contact.  The count overestimates the area: the rim is
inside the last node in contact, and elements as large as the waves they carry are
softer than the solid.  Measured against Westergaard (lines) and periodic Hertz
(spheres), averaged over shifts of the grid (tests/test_fem_closed_forms.py), a straight
rim is

    rim(nu) = 0.25 + 0.21 nu          (+- 0.02)

spacings inside the count.  `corrected` subtracts this for every end of a contact on a
line, and pi/4 of it for every switch along rows and columns of a surface, because a rim
of any direction crosses 4/pi as many rows and columns as its length.  The front between
elastic and capped contact is corrected with the other sign.

`error` combines a systematic part, a quarter of the correction, and a random part,
because each end is rounded to a node: twice the root of a twelfth of the number of
switches on a line, and of a 24th on a surface, where rows and columns count each end
twice.  The random part is most of the error of a few small spots.

If a capped node is the neighbour of an open one, the elastic rim between them is
narrower than a spacing, and the cap times the counted nodes is the load.  Neither front
is corrected there, and both keep their errors: the correction would make the area of
rough surfaces with a hardness of 0.01 to 0.1 E* xi too small by 3 to 19 %.

Plastic area.  For the law "capped" it counts the nodes at the hardness.  For "j2" it
counts contact nodes at an element of the top layer that has ever flowed, less the
plastic area's fraction of the contact's correction.
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
from fem_check.contact import States
from fem_check.path import PathPoint, SolvedPath
from fem_check.problem import Counts

#: Number of pressures at which the distribution is tabulated.
_DISTRIBUTION_POINTS = 1025
#: Largest rms slope at which the gap geometry and small strains are trusted.  At a
#: slope of 0.1 and E* xi/sigma_Y = 50, moving the nodes changed the load by 11 to 13 %.
LARGEST_SLOPE = 0.1
#: Fewest nodes across the median contact.  With fewer nodes, a shift of the grid
#: changes a sphere's area by more than a quarter.
FEWEST_NODES = 4
#: Largest plastic strain at which small strains are trusted.
LARGEST_STRAIN = 0.2


def contact_result(path: SolvedPath) -> ContactResult:
    """Return the result of a solved path, with the fields of its last point.

    The result has one step for each point of the path.  The last step's residuals
    include those of scikit-fem's check.
    """
    problem = path.problem
    block = problem.block
    surface = path.scene.surface
    last = path.points[-1]
    fields = surface_fields(path, last)
    counts = sum((point.counts for point in path.points), Counts())
    options = asdict(path.options)
    del options["approach"], options["certified"]
    options["depth"] = block.depth
    options["layers"] = len(block.layers)
    options["first_layer"] = float(block.layers[0])
    moving_levels = len(block.layers) + int(block.sliding)
    return ContactResult(
        method="fem",
        steps=tuple(load_step(path, point) for point in path.points),
        provenance=Provenance(path.scene.digest, surface.seed, options),
        distribution=distribution(
            fields["pressure"], fields["state"], problem.cap / block.node_area
        ),
        fields={name: values.reshape(surface.shape) for name, values in fields.items()},
        cost={
            "seconds": path.seconds,
            "newton_steps": counts.newton,
            "cg_iterations": counts.cg,
            "contact_sweeps": counts.sweeps,
            "increments": counts.increments,
            "most_newton_steps": counts.most_newton,
            "most_cg_iterations": counts.most_cg,
            "unknowns": 3 * problem.heights.size * moving_levels,
            "peak_memory_bytes": float(peak_memory()),
        },
        history=last.history,
        notes=(*surface.notes, *_warnings(path)),
    )


def surface_fields(path: SolvedPath, point: PathPoint) -> dict[str, NDArray[Any]]:
    """Return the (nx, ny) fields of the surface at a point of the path, by name.

    Args:
        path: the solved path.
        point: one of its points.

    Returns:
        `heights` (m), `pressure` (Pa), `gap` (m), downward `displacement` (m) and
        `state` (APART, ELASTIC or PLASTIC).  A capped body, and a J2 body without a
        load, also have the `plastic_displacement` (m).
    """
    fields: dict[str, NDArray[Any]] = {
        "heights": path.scene.surface.heights,
        "pressure": np.maximum(point.state.forces, 0.0) / path.problem.block.node_area,
        "gap": point.gap,
        "displacement": _downward_displacement(path.scene, point),
        "state": point.surface_states,
    }
    if path.problem.capped:
        fields["plastic_displacement"] = point.plastic_displacement
    elif path.problem.plastic and not point.mean_pressure:
        fields["plastic_displacement"] = fields["displacement"]
    return fields


def _downward_displacement(scene: Scene, point: PathPoint) -> FloatArray:
    """Return the (nx, ny) downward displacement of the top, in m.

    The mean of a half-space's displacement is subtracted.  Under a punch, it is the
    displacement of the material that is now at the position of a node, the unknown of
    `Problem.physical_displacement`.

    Args:
        scene: with the kind of body.
        point: of the solved path.
    """
    down: FloatArray = -point.state.displacement[0, ..., 2]
    if scene.body.kind == "half_space":
        down = down - down.mean()
    return down


def load_step(path: SolvedPath, point: PathPoint) -> LoadStep:
    """Return areas, residuals, iterations and quantities of a point of the path.

    Args:
        path: the solved path.
        point: one of its points; the last one also gets the residuals of scikit-fem's
            check.
    """
    scene = path.scene
    problem = path.problem
    counts = point.counts
    raw, corrected, error = areas(
        point.surface_states, scene.material.poisson_ratio, problem.capped
    )
    residuals = point.residuals
    if point is path.points[-1]:
        residuals = residuals | path.certificate
    pressure = point.state.forces / problem.block.node_area
    touching = point.surface_states != APART
    contact_pressure = 0.0
    if touching.any():
        contact_pressure = float(pressure[touching].mean())
    gap = np.maximum(point.gap + point.plastic_displacement, 0)
    return LoadStep(
        point.mean_pressure,
        {"raw": raw, "corrected": corrected, "error": error},
        residuals,
        {
            "newton": counts.newton,
            "cg": counts.cg,
            "contact_sweeps": counts.sweeps,
            "increments": counts.increments,
            "line_searches": counts.line_searches,
        },
        {
            "mean_gap": float(gap.mean()),
            "mean_separation": float(point.gap.mean()),
            "approach": point.state.approach + float(problem.heights.max()),
            "largest_pressure": float(pressure.max()),
            "mean_contact_pressure": contact_pressure,
            "elastic_energy": _elastic_energy(path, point, pressure),
            **point.flow,
        },
    )


def _elastic_energy(path: SolvedPath, point: PathPoint, pressure: FloatArray) -> float:
    """Return the elastic energy in J/m^2, less a half-space's uniform compression.

    Args:
        path: the solved path.
        point: one of its points.
        pressure: (nx, ny) contact pressures of this point, in Pa.
    """
    scene = path.scene
    law = path.problem.law
    if "stored_energy" not in point.flow:
        # Without plastic flow, the work of the pressures is twice the energy.
        work = pressure * _downward_displacement(scene, point)
        return float(work.mean()) / 2
    energy = point.flow["stored_energy"]
    if scene.body.kind == "half_space":
        confined_modulus = law.bulk_modulus + 4 / 3 * law.shear_modulus
        depth = path.problem.block.depth
        energy -= point.mean_pressure**2 * depth / (2 * confined_modulus)
    return energy


def areas(
    states: States, poisson_ratio: float, capped: bool
) -> tuple[Areas, Areas, Areas]:
    """Return the raw areas, the corrected areas and the errors of the corrected areas.

    All are fractions of the nominal area.  The raw areas count nodes.  The corrected
    ones are smaller by a rim of (0.25 + 0.21 nu) spacings along each edge of the
    contact, because the count includes nodes just outside of the rim.  The module's
    docstring has the details.

    Args:
        states: (nx, ny) APART, ELASTIC or PLASTIC; ny = 1 is a line.
        poisson_ratio: nu of the solid.
        capped: whether plastic nodes are those at the cap of the law "capped".
    """
    touching = states != APART
    plastic = states == PLASTIC
    total_area = float(touching.mean())
    plastic_area = float(plastic.mean())
    is_line = states.shape[1] == 1
    rim = 0.25 + 0.21 * poisson_ratio
    rounding = 12
    if not is_line:
        rim *= math.pi / 4
        rounding = 24
    rim /= states.size
    ends = count_switches(touching)
    fronts = count_switches(plastic)
    total_correction = rim * ends
    plastic_correction = rim * fronts
    if capped:
        # Each pair of an open and a capped node is a switch of both fronts.
        elastic_switches = rim * count_switches(states == ELASTIC)
        shared = (total_correction + plastic_correction - elastic_switches) / 2
        corrected_total = max(0.0, total_area - (total_correction - shared))
        corrected_plastic = min(
            corrected_total, plastic_area + plastic_correction - shared
        )
    else:
        corrected_total = max(0.0, total_area - total_correction)
        remaining = 1.0
        if total_area:
            remaining = corrected_total / total_area
        corrected_plastic = plastic_area * remaining
        plastic_correction = plastic_area - corrected_plastic

    def error(correction: float, switches: int) -> float:
        """Return the error of an area, as a fraction of the nominal area.

        It combines a quarter of the area's `correction` with the random error of
        `switches` neighbours of which only one is inside.
        """
        random_error = 2 * math.sqrt(switches / rounding) / states.size
        return math.hypot(correction / 4, random_error)

    total_error = error(min(total_area, total_correction), ends)
    plastic_error = error(plastic_correction, fronts)
    corrected_elastic = max(corrected_total - corrected_plastic, 0.0)
    return (
        Areas(total_area, total_area - plastic_area, plastic_area),
        Areas(corrected_total, corrected_elastic, corrected_plastic),
        Areas(total_error, total_error + plastic_error, plastic_error),
    )


def count_switches(inside: NDArray[np.bool_]) -> int:
    """Count the pairs of periodic neighbours of which only one is inside.

    Args:
        inside: (nx, ny); neighbours are along rows and columns.
    """
    switches = 0
    for axis in (0, 1):
        if inside.shape[axis] > 1:
            switches += int((inside != np.roll(inside, 1, axis)).sum())
    return switches


def distribution(
    pressure: FloatArray, states: States, cap: float
) -> PressureDistribution:
    """Return the distribution of the nodal pressures, tabulated at 1025 pressures.

    Args:
        pressure: (nx, ny) in Pa; nodes without pressure are not counted.
        states: (nx, ny) contact states.
        cap: largest pressure in Pa, at which nodes are plastic; infinite: there is no
            cap, and plastic nodes count like elastic ones.

    Returns:
        Pressures from 0 to the largest one or the cap, in Pa; the fraction of all nodes
        in contact at or below each of them, without nodes at the cap; and the fraction
        of all nodes at the cap.
    """
    capped = bool(np.isfinite(cap))
    counted = pressure > 0
    plastic = 0.0
    if capped:
        counted &= states != PLASTIC
        plastic = float((states == PLASTIC).mean())
    values = pressure[counted]
    top = float(values.max(initial=0.0)) or 1.0
    if capped:
        top = cap
    edges = np.linspace(0.0, top, _DISTRIBUTION_POINTS)
    cumulative = np.searchsorted(np.sort(values), edges, side="right") / pressure.size
    return PressureDistribution(edges, cumulative, plastic)


def _warnings(path: SolvedPath) -> tuple[str, ...]:
    """Return sentences on halved increments and on the limits of this method.

    The limits are those on slopes, nodes across a contact, depth of the plastic zone,
    and plastic strain.

    Args:
        path: the solved path.

    Returns:
        Sentences for the result's notes; none if no increment was halved and no limit
        is exceeded.
    """
    notes = [
        f"an increment towards point {number} was halved {point.counts.halvings} times"
        for number, point in enumerate(path.points)
        if point.counts.halvings
    ]
    last = path.points[-1]
    slope = path.scene.surface.rms_slope
    if slope > LARGEST_SLOPE:
        notes.append(
            f"the rms slope of {slope:.2g} is too large for small strains (more than "
            f"{LARGEST_SLOPE:g}); scale heights, pressure and strengths down together"
        )
    nodes = nodes_across(last.surface_states != APART)
    if nodes < FEWEST_NODES:
        notes.append(
            f"the median contact is {nodes:.1f} nodes across, fewer than "
            f"{FEWEST_NODES}: areas and pressures depend on the grid"
        )
    if last.flow.get("plastic_depth", 0.0) >= path.problem.block.depth * (1 - 1e-9):
        notes.append("the plastic zone reaches the base; give a deeper block")
    strain = last.flow.get("largest_plastic_strain", 0.0)
    if strain > LARGEST_STRAIN:
        notes.append(
            f"the plastic strain reaches {strain:.2g}, too much for small strains"
        )
    return tuple(notes)


def nodes_across(touching: NDArray[np.bool_]) -> float:
    """Return the number of nodes across the median contact.

    Half of all contact nodes are in contacts that are smaller than the median contact.
    Contacts join over corners and over the periodic edges.

    Args:
        touching: (nx, ny) True for the contact nodes.

    Returns:
        On a line (ny = 1) the width of the contact; on a surface the diameter of a disc
        of its area; 0 without contact.
    """
    if not touching.any():
        return 0.0
    number = np.arange(touching.size).reshape(touching.shape)
    pairs = []
    for shift in ((0, 1), (1, 0), (1, 1), (1, -1)):
        joined = touching & np.roll(touching, shift, (0, 1))
        neighbour = np.roll(number, shift, (0, 1))
        pairs.append([number[joined], neighbour[joined]])
    edges = np.concatenate(pairs, axis=1)
    graph = coo_matrix((np.ones(edges.shape[1]), edges), (number.size, number.size))
    labels = connected_components(graph, directed=False)[1]
    sizes = np.sort(np.bincount(labels[touching.ravel()]))
    median = sizes[np.searchsorted(np.cumsum(sizes), touching.sum() / 2)]
    if touching.shape[1] == 1:
        return float(median)
    return float(2 * math.sqrt(median / math.pi))
