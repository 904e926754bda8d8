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

#: A function that returns pressure/E* on the grid of heights; see `PEERS`.
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
    """Return pressure/E* by ContactMechanics.

    Args:
        heights: over the period, (nx, ny).
        load: mean pressure over E*.
        hardness: over E*; infinite for an elastic body.
        effort: ContactMechanics' tolerance `pentol` on the penetration, over the
            period.
        lengths: both periods, over the first.

    Raises:
        ImportError: if the package is not installed.
    """
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
    """Return pressure/E* by tamaas.

    Args:
        heights: over the period, (nx, ny).
        load: mean pressure over E*.
        hardness: over E*; infinite for an elastic body.
        effort: relative tolerance or, with a finite hardness, the number of iterations.
        lengths: both periods, over the first.

    Raises:
        ImportError: if the package is not installed.
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
    """Solve a scene by ContactMechanics.

    The result is at the last load of the path.  Raises InvalidScene if the scene is not
    a half-space under a surface or its load path unloads a capped body, and
    NotConverged if ContactMechanics fails.
    """
    rms_height = float(np.std(scene.surface.heights))
    effort = TOLERANCE * rms_height / scene.surface.periods[0]
    return _solve(scene, "contact_mechanics", "ContactMechanics", effort)


def tamaas(scene: Scene) -> ContactResult:
    """Solve a scene by tamaas.

    The result is at the last load of the path.  Raises InvalidScene if the scene is not
    a half-space under a surface or its load path unloads a capped body, and
    NotConverged if tamaas fails.
    """
    effort: float = ITERATIONS
    if math.isinf(scene.material.hardness):
        effort = TOLERANCE
    return _solve(scene, "tamaas", "tamaas", effort)


def _solve(scene: Scene, name: str, package: str, effort: float) -> ContactResult:
    """Solve a scene by a package.

    Args:
        scene: the scene.
        name: of the method in the result.
        package: the package's key in `PEERS`.
        effort: its setting of accuracy, as the function in `PEERS` takes it.

    Raises:
        InvalidScene: if the package does not solve such a scene.
        NotConverged: if the package fails.
    """
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
    """Change errors of a package inside of the `with` block to NotConverged.

    On entry it raises InvalidScene if the scene is not a half-space under a surface.

    Args:
        scene: the scene that the package solves.
        package: name of the package, for messages.
    """
    if scene.surface.heights.ndim != 2 or scene.body.kind != "half_space":
        raise InvalidScene(f"{package} is used for half-spaces under surfaces only")
    try:
        yield
    except (RuntimeError, ArithmeticError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise NotConverged(f"{package} gave up: {reason}") from error
