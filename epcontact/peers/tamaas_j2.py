"""tamaas with perfectly plastic J2 flow: a second opinion on the finite elements.

Contact and flow are solved in turns until the residual displacement settles (Frérot et
al. 2019, Comput. Methods Appl. Mech. Eng. 351, 951), in INCREMENTS from each load to
the next.  tamaas' own outer loop, EPICSolver, has a fixed relaxation, and starts from
elastic contact.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import NoConvergence, anderson

from epcontact import bem
from epcontact.errors import InvalidScene
from epcontact.materials.moduli import effective_modulus
from epcontact.peers.pressure_result import result_of_pressures
from epcontact.peers.public_codes import errors_of_package
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Load, Scene

#: Depths, over the period, of the layer in which the body may flow.  The second is
#: used if the deepest points of the first one flow.
FLOWING = (0.5, 1.0)
#: Increments from each load to the next.
INCREMENTS = 4
#: Relative tolerance of both loops: a tenth of it moves areas of rough bodies of 17 x
#: 17 points by 0.3 % at most.
FLOW_TOLERANCE = 1e-4
#: Cap over the yield stress from whose contact an increment starts: elastic pressures
#: on fine grids are more than a flowing body can carry.
START_CAP = 2.5
#: Mixing factor of Anderson's acceleration of the outer loop.
MIXING = 0.5
#: Number of earlier iterations that the acceleration uses.
EARLIER = 3
#: Largest number of iterations of the outer loop in an increment.
MOST_ITERATIONS = 100
#: Smallest scale of the tolerance: norm of the plastic displacement over that of the
#: heights.  A body with less flow is solved to the same absolute tolerance.
_LEAST_FLOW = 0.01
#: Hardening over Young's modulus: tamaas divides by it, and this small one changes no
#: digit that its tolerance leaves.
_HARDENING = 1e-9


def tamaas_j2(scene: Scene) -> ContactResult:
    """Solve a scene by tamaas' volume integrals with J2 flow.

    Raises:
        InvalidScene: if the body does not flow, the load falls, or the scene is no
            half-space under a surface.
        NotConverged: if the loops do not settle, or the body flows too deep.
    """
    if not (math.isfinite(scene.material.yield_stress) and scene.load.non_decreasing):
        raise InvalidScene(
            "tamaas_j2 needs a finite yield_stress and mean pressures that rise"
        )
    modulus = effective_modulus(scene.material)
    started = time.perf_counter()
    with errors_of_package(scene, "tamaas"):
        try:
            depth, pressure, gap, solves = _solve_to_depth(scene)
        except NoConvergence:
            raise RuntimeError(
                f"flow and contact do not settle in {MOST_ITERATIONS} iterations"
            ) from None
    seconds = time.perf_counter() - started
    displacement = gap + scene.surface.heights
    displacement -= displacement.mean()
    fields = {"pressure": pressure * modulus, "gap": gap, "displacement": displacement}
    result = result_of_pressures(scene, fields, "tamaas_j2", seconds, flows=True)
    options = {
        "law": "j2",
        "depth": depth,
        "compliance": "half_space",
        "solver": "tamaas_j2",
    }
    return replace(
        result,
        provenance=replace(result.provenance, options=options),
        cost={**result.cost, "iterations": solves},
    )


def _solve_to_depth(scene: Scene) -> tuple[float, FloatArray, FloatArray, int]:
    """Solve a scene with flow in the shallowest layer that is deep enough.

    Returns:
        The depth of the layer (m), pressure/E* and the gap (m), both on the grid of the
        scene, and how often contact and flow were solved in turn.

    Raises:
        RuntimeError: if the body flows at the bottom of the deepest layer of `FLOWING`.
        NoConvergence: if contact and flow do not settle.
    """
    for fraction in FLOWING:
        depth = fraction * scene.surface.periods[0]
        pressure, gap, deepest_strain, solves = _solve_flow(scene, depth)
        if deepest_strain == 0:
            return depth, pressure, gap, solves
    raise RuntimeError(f"the body flows deeper than {FLOWING[-1]:g} periods")


def _solve_flow(
    scene: Scene, depth: float
) -> tuple[FloatArray, FloatArray, float, int]:
    """Solve contact and flow in turn, in increments along the load path.

    Args:
        scene: the scene.
        depth: the depth in m down to which the body may flow.

    Returns:
        pressure/E* and the gap (m), both on the grid of the scene, the largest plastic
        strain at that depth, and how often contact and flow were solved in turn.

    Raises:
        NoConvergence: if they do not settle in `MOST_ITERATIONS`.
    """
    modulus = effective_modulus(scene.material)
    period = scene.surface.periods[0]
    heights = scene.surface.heights / period
    model, contact, flow = _tamaas_solvers(scene, depth / period)
    residual_before = np.zeros_like(heights)
    traction_before = np.zeros_like(model.traction)
    solves: list[float] = []
    smallest = _LEAST_FLOW * float(np.linalg.norm(heights - heights.mean()))

    def change(residual: FloatArray, load: float) -> FloatArray:
        """Return the error of a residual displacement: its new value less itself.

        Contact is solved on the surface that earlier increments and `residual` (both
        over the period, on the grid) have lowered, under `load` (mean pressure over
        E*).  Then flow is solved under the contact's pressures.
        """
        solves.append(load)
        contact.surface[:] = (heights - residual_before - residual).ravel()
        contact.solve(load)
        traction = np.array(model.traction)
        # The flow solver takes the change of the pressures in an increment.
        model.traction[...] = traction - traction_before
        flow.solve()
        caused = np.array(model.displacement)[0, ..., 2]
        model.traction[...] = traction
        return np.asarray(caused - caused.mean() - residual)

    for load in _increments(scene.load.path):
        guess = _plastic_displacement(scene, load) / period - residual_before
        scale = max(float(np.linalg.norm(residual_before + guess)), smallest)
        residual = anderson(
            partial(change, load=load / modulus),
            guess,
            alpha=MIXING,
            M=EARLIER,
            line_search=None,
            maxiter=MOST_ITERATIONS,
            f_tol=FLOW_TOLERANCE * scale,
            tol_norm=np.linalg.norm,
        )
        traction = np.array(model.traction)
        model.traction[...] = traction - traction_before
        flow.updateState()
        model.traction[...] = traction
        residual_before = residual_before + residual
        traction_before = traction
    gap = period * np.array(model["gap"]).reshape(*heights.shape, -1)[..., -1]
    deepest_strain = float(np.array(model["cumulated_plastic_strain"])[-1].max())
    return traction_before[..., 2], gap, deepest_strain, len(solves)


def _increments(path: tuple[float, ...]) -> list[float]:
    """Return the mean pressures (Pa) of all increments, from those of a load path.

    Each load of the path is reached from the one before, or from 0, in INCREMENTS equal
    increments.
    """
    loads = []
    for start, end in pairwise((0.0, *path)):
        for number in range(1, INCREMENTS + 1):
            loads.append(start + (end - start) * (number / INCREMENTS))
    return loads


def _tamaas_solvers(scene: Scene, depth: float) -> tuple[Any, Any, Any]:
    """Return tamaas' model of the body, and its solvers of contact and of flow.

    Args:
        scene: the scene.
        depth: down to which the body may flow, over the period.
    """
    import tamaas as tm
    from tamaas.nonlinear_solvers import DFSANECXXSolver

    tm.set_log_level(tm.LogLevel.error)
    surface, material = scene.surface, scene.material
    modulus = effective_modulus(material)
    period = surface.periods[0]
    lengths = [depth, 1.0, surface.periods[1] / period]
    # The layers are as far apart as the points of the surface.
    layers = round(depth * surface.shape[0]) + 1
    model = tm.Model(tm.model_type.volume_2d, lengths, [layers, *surface.shape])
    model.E = material.young_modulus / modulus
    model.nu = material.poisson_ratio
    law = tm.materials.IsotropicHardening(
        model, material.yield_stress / modulus, _HARDENING * model.E
    )
    flow = DFSANECXXSolver(tm.Residual(model, law))
    flow.tolerance = FLOW_TOLERANCE
    contact = tm.PolonskyKeerRey(model, np.array(surface.heights) / period, 1e-8)
    return model, contact, flow


def _plastic_displacement(scene: Scene, load: float) -> FloatArray:
    """Return the plastic displacement of a body with a cap on the pressure.

    It is a first guess of the residual displacement of the J2 body.

    Args:
        scene: the scene of the J2 body.
        load: mean pressure in Pa.

    Returns:
        The displacement in m, downward and with a mean of 0, on the grid of the scene.
    """
    hardness = max(START_CAP * scene.material.yield_stress, 2 * load)
    material = replace(scene.material, hardness=hardness)
    capped = replace(scene, material=material, load=Load(load))
    gap = bem.solve(capped, threads=1).fields["gap"]
    plastic_displacement = np.maximum(-gap, 0.0)
    return np.asarray(plastic_displacement - plastic_displacement.mean())
