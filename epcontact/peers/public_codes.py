"""Public solvers of capped contact: ContactMechanics and tamaas, of the extra `peers`.

    ContactMechanics   conjugate gradients of Polonsky and Keer with a hardness
    tamaas             the same without one, Kato's method with a saturation pressure

A peer gives a pressure field, from which everything else follows as for every code
(`pressure_result`).  Peers get the problem in units of E* and the period, because their
absolute tolerances assume numbers near 1.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from epcontact.errors import InvalidScene, NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.peers.pressure_result import result_of_pressures
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

#: Returns pressure/E* on the grid of heights; see `PEERS`.
Pressure = Callable[..., FloatArray]

#: The tightest relative tolerance on the penetration or the gap with which the cases of
#: the package can be solved.
TOLERANCE = 1e-6
#: Iterations of tamaas' saturated solver, which reports no error.
ITERATIONS = 3200


def _contact_mechanics_pressure(
    heights: FloatArray,
    load: float,
    hardness: float,
    effort: Any,
    lengths: Any = (1.0, 1.0),
) -> FloatArray:
    """Return pressure/E* by ContactMechanics; `effort` is its option `pentol`."""
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Optimization import constrained_conjugate_gradients

    nominal_area = lengths[0] * lengths[1]
    cell = nominal_area / heights.size
    found = constrained_conjugate_gradients(
        PeriodicFFTElasticHalfSpace(heights.shape, 1.0, lengths),
        heights,
        hardness=None if math.isinf(hardness) else hardness * cell,
        external_force=load * nominal_area,
        pentol=effort,
        maxiter=20000,
    )
    return np.asarray(found.jac / cell)


def _tamaas_pressure(
    heights: FloatArray,
    load: float,
    hardness: float,
    effort: Any,
    lengths: Any = (1.0, 1.0),
) -> FloatArray:
    """Return pressure/E* by tamaas; `effort` is a tolerance or, with a hardness, the
    number of iterations.
    """
    import tamaas as tm

    tm.set_log_level(tm.LogLevel.error)
    model = tm.Model(tm.model_type.basic_2d, list(lengths), list(heights.shape))
    model.E = 1.0
    model.nu = 0.0
    if math.isinf(hardness):
        solver = tm.PolonskyKeerRey(model, heights, float(effort or 1e-8))
    else:
        solver = tm.KatoSaturated(model, heights, 1e-8, hardness)
        solver.max_iter = int(effort or 100)
    solver.solve(load)
    return np.array(model.traction)


#: By package: the function that maps (heights, load, hardness, effort, lengths) to
#: pressure/E*.  Heights and lengths are over the period, load and hardness over E*.
PEERS: dict[str, Pressure] = {
    "ContactMechanics": _contact_mechanics_pressure,
    "tamaas": _tamaas_pressure,
}


def contact_mechanics(scene: Scene) -> ContactResult:
    """Solve a scene by ContactMechanics.  Raises InvalidScene, NotConverged."""
    rms_height = float(np.std(scene.surface.heights))
    effort = TOLERANCE * rms_height / scene.surface.periods[0]
    return _solve(scene, "contact_mechanics", "ContactMechanics", effort)


def tamaas(scene: Scene) -> ContactResult:
    """Solve a scene by tamaas.  Raises InvalidScene, NotConverged."""
    elastic = math.isinf(scene.material.hardness)
    return _solve(scene, "tamaas", "tamaas", TOLERANCE if elastic else ITERATIONS)


def _solve(scene: Scene, name: str, package: str, effort: float) -> ContactResult:
    modulus = effective_modulus(scene.material)
    periods = scene.surface.periods
    heights = np.array(scene.surface.heights) / periods[0]
    started = time.perf_counter()
    with errors_of_package(scene, package):
        pressure = PEERS[package](
            heights,
            scene.load.final / modulus,
            scene.material.hardness / modulus,
            effort,
            (1.0, periods[1] / periods[0]),
        )
    seconds = time.perf_counter() - started
    return result_of_pressures(scene, {"pressure": pressure * modulus}, name, seconds)


@contextlib.contextmanager
def errors_of_package(scene: Scene, package: str) -> Iterator[None]:
    """Raise NotConverged for the errors of a package in the block.

    Raises InvalidScene at once if the package does not know such a scene.
    """
    if scene.surface.heights.ndim != 2 or scene.body.kind != "half_space":
        raise InvalidScene(f"{package} is asked for half-spaces under surfaces only")
    try:
        yield
    except (RuntimeError, ArithmeticError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise NotConverged(f"{package} gave up: {reason}") from error
