"""A scene answered by the plain finite elements: the method "plain".

`solve_plain` builds the block of a scene, solves its load path by `plain.solve_path`
and returns a result.  The block has the nodes that the fast elements choose for the
scene, and its areas are estimated by the same functions; the mechanics is `plain`'s.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.helpers import ddot

from epcontact.errors import InvalidScene
from epcontact.machine import forget_peak, peak_memory
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    ContactResult,
    FloatArray,
    LoadStep,
    Provenance,
)
from epcontact.scene import Scene, require_kind
from fem_check.mesh import block_for
from fem_check.options import FemOptions
from fem_check.plain import Law, PlainBlock, State, law_of, solve_path
from fem_check.result import areas, distribution

#: Most elements of a block.  Their assembly takes a minute for some 6,000 of them, and
#: the fast elements solve larger blocks.
MOST_ELEMENTS = 20_000


def solve_plain(
    scene: Scene,
    options: FemOptions | None = None,
    *,
    on_step: Callable[[ContactResult], None] | None = None,
    **changes: Any,
) -> ContactResult:
    """Solve the contact of a scene along its load path by plain finite elements.

    Args:
        scene: the surface, the material, the body and the mean pressures.
        options: of the solve; None: the defaults of `FemOptions`.
        on_step: called after each load with the result up to it.
        changes: single options by name, as in `solve_plain(scene, law="elastic")`.

    Returns:
        The result with one step for each mean pressure and the fields of the last one.

    Raises:
        InvalidScene: the scene or the options are not for this method: a law with a
            pressure cap, a punch, a prescribed approach, or too many elements.
        NotConverged: an increment did not reach the tolerance.

    Example:
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> heights = 0.01 * np.cos(2 * np.pi * np.arange(16) / 16)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.3), Load(0.01))
        >>> solve_plain(scene, law="elastic").final.areas["raw"].total
        0.4375
    """
    require_kind("scene", scene, Scene)
    options = replace(options or FemOptions(), **changes)
    started = time.perf_counter()
    forget_peak()
    block = plain_block(scene, options)
    steps: list[LoadStep] = []
    newton_steps = 0
    cg_iterations = 0
    path = solve_path(block, scene.load.path, options.steps, options.tolerance)
    for mean_pressure, state in zip(scene.load.path, path, strict=True):
        newton_steps += state.newton_steps
        cg_iterations += state.cg_iterations
        fields = surface_fields(scene, block, state)
        steps.append(load_step(scene, block, state, mean_pressure, fields))
        result = ContactResult(
            method="plain",
            steps=tuple(steps),
            provenance=Provenance(
                scene.digest, scene.surface.seed, _stated_options(block, options)
            ),
            distribution=distribution(fields["pressure"], fields["state"], math.inf),
            fields={
                name: values.reshape(scene.surface.shape)
                for name, values in fields.items()
            },
            cost={
                "seconds": time.perf_counter() - started,
                "newton_steps": newton_steps,
                "cg_iterations": cg_iterations,
                "unknowns": len(state.displacement),
                "peak_memory_bytes": float(peak_memory()),
            },
            notes=scene.surface.notes,
        )
        if on_step is not None:
            on_step(result)
    return result


def plain_block(scene: Scene, options: FemOptions) -> PlainBlock:
    """Return the block of a scene.

    Args:
        scene: the surface, the material and the body.
        options: law, geometry, depth and layers.

    Raises:
        InvalidScene: the options are not for this method, or contradict the scene.
    """
    options.require_strengths(scene)
    if options.law == "capped" or options.geometry == "punch" or options.approach:
        raise InvalidScene(
            "plain finite elements have the laws 'elastic' and 'j2', the geometries "
            "'gap' and 'moved', and prescribed mean pressures; take the method fem for "
            "law='capped', geometry='punch' or approach"
        )
    block = block_for(scene, options)
    count = math.prod(block.shape) * len(block.layers)
    if count > MOST_ELEMENTS:
        raise InvalidScene(
            f"the block has {count} elements, but plain finite elements take at most "
            f"{MOST_ELEMENTS}; give a coarser surface, fewer layers, or the method fem"
        )
    moved = options.geometry == "moved"
    heights = scene.surface.heights.reshape(block.shape)
    if moved:
        heights = heights - heights.mean()
    return PlainBlock(
        heights=heights,
        spacing=block.spacing,
        law=law_of(scene.material, flows=options.law == "j2"),
        levels=block.depth + block.levels[::-1],
        moved=moved,
        sliding=block.sliding,
    )


def _stated_options(block: PlainBlock, options: FemOptions) -> dict[str, Any]:
    """Return the options of a solve, with the depth and layers that were chosen."""
    stated = asdict(options)
    del stated["approach"], stated["certified"]
    stated["depth"] = float(block.levels[-1])
    stated["layers"] = len(block.levels) - 1
    stated["first_layer"] = float(block.levels[-1] - block.levels[-2])
    return stated


def surface_fields(
    scene: Scene, block: PlainBlock, state: State
) -> dict[str, NDArray[Any]]:
    """Return the (nx, ny) fields of the top, by name.

    Args:
        scene: with the kind of body.
        block: the body.
        state: its equilibrium.

    Returns:
        `heights` (m), `pressure` (Pa), `gap` (m), downward `displacement` (m) and
        `state` (APART, ELASTIC, or PLASTIC for contact on an element that has flowed);
        without a load also the `plastic_displacement` (m).
    """
    shape = block.heights.shape
    down = -state.displacement[block.top].reshape(shape)
    contact = state.contact.reshape(shape)
    gap = np.where(contact, 0.0, state.flat - block.heights + down)
    if scene.body.kind == "half_space":
        down = down - down.mean()
    states = np.where(contact, ELASTIC, APART).astype(np.int8)
    states[contact & yielded_nodes(block, state)] = PLASTIC
    pressure = np.maximum(state.forces, 0.0).reshape(shape)
    fields: dict[str, NDArray[Any]] = {
        "heights": scene.surface.heights,
        "pressure": pressure * block.heights.size / block.area,
        "gap": gap,
        "displacement": down,
        "state": states,
    }
    if block.law.flows and not contact.any():
        fields["plastic_displacement"] = down
    return fields


def yielded_nodes(block: PlainBlock, state: State) -> NDArray[np.bool_]:
    """Return (nx, ny) True for the top nodes of an element that has ever flowed."""
    i, j, level = block.indices
    flowed = state.history.accumulated.any(axis=1)
    nodes = block.elements.mesh.t[:, flowed].ravel()
    nodes = nodes[level[nodes] == len(block.levels) - 1]
    yielded = np.zeros(block.heights.shape, dtype=bool)
    yielded[i[nodes], j[nodes]] = True
    return yielded


def load_step(
    scene: Scene,
    block: PlainBlock,
    state: State,
    mean_pressure: float,
    fields: dict[str, NDArray[Any]],
) -> LoadStep:
    """Return areas, residuals, iterations and quantities of a state.

    Args:
        scene: with the material and the kind of body.
        block: the body.
        state: its equilibrium.
        mean_pressure: in Pa.
        fields: from `surface_fields`.
    """
    raw, corrected, error = areas(
        fields["state"], scene.material.poisson_ratio, capped=False
    )
    contact = fields["state"] != APART
    pressure = fields["pressure"]
    contact_pressure = 0.0
    if contact.any():
        contact_pressure = float(pressure[contact].mean())
    mean_gap = float(np.maximum(fields["gap"], 0).mean())
    stored = stored_energy(block, state)
    energy = stored
    if scene.body.kind == "half_space":
        confined_modulus = block.law.bulk_modulus + 4 / 3 * block.law.shear_modulus
        energy -= mean_pressure**2 * float(block.levels[-1]) / (2 * confined_modulus)
    quantities = {
        "mean_gap": mean_gap,
        "mean_separation": mean_gap,
        "approach": float(block.heights.max()) - state.flat,
        "largest_pressure": float(pressure.max()),
        "mean_contact_pressure": contact_pressure,
        "elastic_energy": energy,
    }
    if block.law.flows:
        quantities |= {"stored_energy": stored, **plastic_flow(block, state)}
    return LoadStep(
        mean_pressure,
        {"raw": raw, "corrected": corrected, "error": error},
        state.residuals,
        {"newton": state.newton_steps, "cg": state.cg_iterations},
        quantities,
    )


def stored_energy(block: PlainBlock, state: State) -> float:
    """Return the elastic energy over the nominal area, in J/m^2.

    It is the integral of |s|^2/(4 mu) + K <div u>^2/2, with the deviatoric stress s and
    the mean dilatation <div u>.
    """
    elements = block.elements
    u = block.unknowns @ state.displacement
    mu = block.law.shear_modulus
    strain = elements.deviatoric_strain(u) - state.history.plastic_strain
    shear = mu * float((elements.basis.dx * ddot(strain, strain)).sum())
    dilatation = elements.mean_dilatation(u)
    compression = block.law.bulk_modulus / 2 * float(elements.volumes @ dilatation**2)
    return (shear + compression) / block.area


def plastic_flow(block: PlainBlock, state: State) -> dict[str, float]:
    """Return measures of the plastic flow of a state, by name.

    Returns:
        `largest_plastic_strain` (accumulated); `plastic_volume`, the fraction of the
        volume that has flowed; `plastic_depth` in m; `plastic_work` in J/m^2.
    """
    strain = state.history.accumulated
    dx = block.elements.basis.dx
    flowed = strain.any(axis=1)
    levels = block.indices[2][block.elements.mesh.t[:, flowed]]
    lowest = int(levels.min(initial=len(block.levels) - 1))
    work = plastic_work_density(block.law, strain)
    return {
        "largest_plastic_strain": float(strain.max()),
        "plastic_volume": float(dx[strain > 0].sum() / dx.sum()),
        "plastic_depth": float(block.levels[-1] - block.levels[lowest]),
        "plastic_work": float((dx * work).sum()) / block.area,
    }


def plastic_work_density(law: Law, accumulated: FloatArray) -> FloatArray:
    """Return the plastic work per volume in J/m^3, the integral of the yield stress.

    Args:
        law: of the material.
        accumulated: accumulated plastic strains, of any shape.
    """
    work = np.zeros_like(accumulated)
    ends = [begin for begin, _, _ in law.segments[1:]] + [math.inf]
    for (begin, stress, slope), end in zip(law.segments, ends, strict=True):
        part = np.clip(accumulated - begin, 0.0, end - begin)
        work += stress * part + slope * part**2 / 2
    return work
