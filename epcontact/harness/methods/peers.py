"""Public solvers as methods: ContactMechanics and tamaas, with the extra `peers`.

    ContactMechanics   constrained conjugate gradients of Polonsky and Keer with a hardness
    tamaas             the same without one, Kato's method with a saturation pressure
    tamaas_j2          tamaas' volume integrals with J2 flow, a second opinion on finite elements

A peer gives a pressure field, from which `result_of` computes everything else (gap,
residuals, areas, energy) in the same way for every peer, so that a gate judges the
pressure alone.  Peers get the problem in units of E* and the period, because their
absolute tolerances assume numbers near 1.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import NoConvergence, anderson

from epcontact import bem, results
from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.driver import areas_and_quantities
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.errors import InvalidScene, NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.results import ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Load, Scene

Pressure = Callable[..., FloatArray]

#: The tightest settings with which the package's cases can be solved: relative
#: tolerance on the penetration or the gap, and iterations of tamaas' saturated solver,
#: which reports no error.
TOLERANCE, ITERATIONS = 1e-6, 3200

#: Of J2 flow: depths over the period down to which a body may flow, tried until nothing
#: flows in the lowest layer; increments to each load; tolerance of both loops (a tenth
#: of it moves areas of rough bodies of 17 x 17 points by 0.3 % at most).
FLOWING, INCREMENTS, FLOW_TOLERANCE = (0.5, 1.0), 4, 1e-4
#: Cap over the yield stress from whose contact an increment starts: elastic pressures
#: on fine grids are more than a flowing body can carry.
START_CAP = 2.5
#: Mixing, and number of earlier iterations, of Anderson's acceleration of the outer
#: loop.
MIXING, EARLIER, MOST_ITERATIONS = 0.5, 3, 100


def _contact_mechanics_pressure(
    heights: FloatArray,
    load: float,
    hardness: float,
    effort: Any,
    lengths: Any = (1.0, 1.0),
) -> FloatArray:
    """Return pressure/E* by ContactMechanics on periods near 1; `effort` is its
    `pentol`.
    """
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Optimization import constrained_conjugate_gradients

    nominal = lengths[0] * lengths[1]
    cell = nominal / heights.size
    found = constrained_conjugate_gradients(
        PeriodicFFTElasticHalfSpace(heights.shape, 1.0, lengths),
        heights,
        hardness=None if math.isinf(hardness) else hardness * cell,
        external_force=load * nominal,
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
    """Return pressure/E* by tamaas; `effort` is a tolerance or, with a hardness,
    iterations.
    """
    import tamaas as tm

    tm.set_log_level(tm.LogLevel.error)
    model = tm.Model(tm.model_type.basic_2d, list(lengths), list(heights.shape))
    model.E, model.nu = 1.0, 0.0
    if math.isinf(hardness):
        solver = tm.PolonskyKeerRey(model, heights, float(effort or 1e-8))
    else:
        solver = tm.KatoSaturated(model, heights, 1e-8, hardness)
        solver.max_iter = int(effort or 100)
    solver.solve(load)
    return np.array(model.traction)


#: By package: the function that maps (heights, load, hardness, effort, lengths) to
#: pressure/E*.
PEERS: dict[str, Pressure] = {
    "ContactMechanics": _contact_mechanics_pressure,
    "tamaas": _tamaas_pressure,
}


def contact_mechanics(scene: Scene) -> ContactResult:
    """Solve a scene by ContactMechanics.  Raises InvalidScene, NotConverged."""
    effort = TOLERANCE * float(np.std(scene.surface.heights)) / scene.surface.periods[0]
    return _answer(scene, "contact_mechanics", "ContactMechanics", effort)


def tamaas(scene: Scene) -> ContactResult:
    """Solve a scene by tamaas.  Raises InvalidScene, NotConverged."""
    elastic = math.isinf(scene.material.hardness)
    return _answer(scene, "tamaas", "tamaas", TOLERANCE if elastic else ITERATIONS)


def _answer(scene: Scene, name: str, package: str, effort: float) -> ContactResult:
    E, periods = effective_modulus(scene.material), scene.surface.periods
    heights, started = np.array(scene.surface.heights) / periods[0], time.perf_counter()
    loads, aspect = (
        (scene.load.final / E, scene.material.hardness / E),
        periods[1] / periods[0],
    )
    with _peer(scene, package):
        pressure = PEERS[package](heights, *loads, effort, (1.0, aspect))
    return result_of(
        scene, {"pressure": pressure * E}, name, time.perf_counter() - started
    )


def tamaas_j2(scene: Scene) -> ContactResult:
    """Solve a scene by tamaas' volume integrals with perfectly plastic J2 flow.  Contact and flow
    are solved in turns until the residual displacement settles (Frérot et al.  2019, Comput.
    Methods Appl. Mech. Eng. 351, 951), in INCREMENTS from each load to the next.  tamaas' own outer
    loop, EPICSolver, has a fixed relaxation, and starts from elastic contact.
    """
    if not (math.isfinite(scene.material.yield_stress) and scene.load.non_decreasing):
        raise InvalidScene(
            "tamaas_j2 needs a finite yield_stress and mean pressures that rise"
        )
    E, started = effective_modulus(scene.material), time.perf_counter()
    with _peer(scene, "tamaas"):
        for depth in (share * scene.surface.periods[0] for share in FLOWING):
            pressure, gap, deepest, solves = _tamaas_flow(scene, depth)
            if deepest == 0:
                break
        else:
            raise RuntimeError(f"the body flows deeper than {FLOWING[-1]:g} periods")
    seconds, displacement = time.perf_counter() - started, gap + scene.surface.heights
    displacement -= displacement.mean()
    fields = {"pressure": pressure * E, "gap": gap, "displacement": displacement}
    found = result_of(scene, fields, "tamaas_j2", seconds, flows=True)
    options = {
        "law": "j2",
        "depth": depth,
        "compliance": "half_space",
        "solver": "tamaas_j2",
    }
    origin = replace(found.provenance, options=options)
    return replace(
        found, provenance=origin, cost=dict(found.cost) | {"iterations": solves}
    )


@contextlib.contextmanager
def _peer(scene: Scene, package: str) -> Iterator[None]:
    """Refuse a scene that a package does not know, and tell its errors as
    NotConverged.
    """
    if scene.surface.heights.ndim != 2 or scene.body.kind != "half_space":
        raise InvalidScene(f"{package} is asked for half-spaces under surfaces only")
    try:
        yield
    except NoConvergence:
        raise NotConverged(
            f"{package} gave up: flow and contact do not settle in {MOST_ITERATIONS} iterations"
        ) from None
    except (RuntimeError, ArithmeticError, ValueError) as error:
        raise NotConverged(
            f"{package} gave up: {' '.join(str(error).split())}"
        ) from error


def _tamaas_flow(
    scene: Scene, depth: float
) -> tuple[FloatArray, FloatArray, float, int]:
    """Return pressure/E*, the gap (m), the largest plastic strain in the lowest layer,
    and how often contact and flow were solved in turn.
    """
    E, period = effective_modulus(scene.material), scene.surface.periods[0]
    heights = scene.surface.heights / period
    model, contact, flow = _tamaas_body(scene, depth / period)
    settled, carried, solves = (
        np.zeros_like(heights),
        np.zeros_like(model.traction),
        list[float](),
    )
    least = 0.01 * float(
        np.linalg.norm(heights - heights.mean())
    )  # where next to nothing flows

    def change(residual: FloatArray, load: float) -> FloatArray:
        """Solve contact and flow, and return by how much the residual displacement is
        wrong.
        """
        solves.append(load)
        contact.surface[:] = (heights - settled - residual).ravel()
        contact.solve(load)
        traction = np.array(model.traction)
        model.traction[...] = (
            traction - carried
        )  # flow is solved for what an increment adds
        flow.solve()
        made = np.array(model.displacement)[0, ..., 2]
        model.traction[...] = traction
        return np.asarray(made - made.mean() - residual)

    path = (0.0, *scene.load.path)
    shares = np.arange(1, INCREMENTS + 1) / INCREMENTS
    for load in (p + (q - p) * share for p, q in pairwise(path) for share in shares):
        guess = _plastic_displacement(scene, load) / period - settled
        scale = max(float(np.linalg.norm(settled + guess)), least)
        residual = anderson(
            partial(change, load=load / E),
            guess,
            alpha=MIXING,
            M=EARLIER,
            line_search=None,
            maxiter=MOST_ITERATIONS,
            f_tol=FLOW_TOLERANCE * scale,
            tol_norm=np.linalg.norm,
        )
        traction = np.array(model.traction)
        model.traction[...] = traction - carried
        flow.updateState()
        model.traction[...] = traction
        settled, carried = settled + residual, traction
    gap = period * np.array(model["gap"]).reshape(*heights.shape, -1)[..., -1]
    deepest = float(np.array(model["cumulated_plastic_strain"])[-1].max())
    return carried[..., 2], gap, deepest, len(solves)


def _tamaas_body(scene: Scene, flowing: float) -> tuple[Any, Any, Any]:
    """Return tamaas' model of the body, and its solvers of contact and of flow."""
    import tamaas as tm
    from tamaas.nonlinear_solvers import DFSANECXXSolver

    tm.set_log_level(tm.LogLevel.error)
    surface, material = scene.surface, scene.material
    E, period = effective_modulus(material), surface.periods[0]
    lengths = [flowing, 1.0, surface.periods[1] / period]
    levels = (
        round(flowing * surface.shape[0]) + 1
    )  # as far apart as the points of the surface
    model = tm.Model(tm.model_type.volume_2d, lengths, [levels, *surface.shape])
    model.E, model.nu = material.young_modulus / E, material.poisson_ratio
    # tamaas divides by the hardening; 1e-9 of E changes no digit that its tolerance
    # leaves.
    law = tm.materials.IsotropicHardening(
        model, material.yield_stress / E, 1e-9 * model.E
    )
    flow = DFSANECXXSolver(tm.Residual(model, law))
    flow.tolerance = FLOW_TOLERANCE
    return (
        model,
        tm.PolonskyKeerRey(model, np.array(surface.heights) / period, 1e-8),
        flow,
    )


def _plastic_displacement(scene: Scene, load: float) -> FloatArray:
    """Return that of a body under a cap (m), of zero mean: no elastic body whose
    heights are less by it presses with more than the cap.
    """
    hardness = max(START_CAP * scene.material.yield_stress, 2 * load)
    capped = replace(
        scene, material=replace(scene.material, hardness=hardness), load=Load(load)
    )
    gap = bem.solve(capped, threads=1).fields["gap"]
    sunk = np.maximum(-gap, 0.0)
    return np.asarray(sunk - sunk.mean())


def result_of(
    scene: Scene,
    given: Mapping[str, Any],
    name: str,
    seconds: float = 0.0,
    before: FloatArray | None = None,
    flows: bool = False,
) -> ContactResult:
    """Compute the result that follows at the last load from the pressure field `given` (Pa).  A
    displacement or a gap that is not given follows from it, the flat where the mean gap of elastic
    points vanishes or, without any, at the highest plastic one.  before: how far the load before
    has left the surface lowered, in m; flows: by J2, so that no cap bounds the pressures.  The
    residuals are the largest gap of an elastic point over the rms height, and the missing load.
    """
    surface, load, pressure = scene.surface, scene.load, given["pressure"]
    for field in ("pressure", "gap", "displacement"):
        if not np.isfinite(given.get(field, 0)).all():
            raise InvalidScene(
                f"{field} is infinite or NaN at a point, and must be finite at all"
            )
    displacement, gap = given.get("displacement"), given.get("gap")
    if displacement is None:
        q = rfft_wavenumbers(surface.shape, surface.periods)
        modes = surface_compliance(q, scene.body, scene.material) * np.fft.rfftn(
            pressure
        )
        displacement = np.fft.irfftn(modes, s=surface.shape, axes=range(pressure.ndim))
    hardness = math.inf if flows else scene.material.hardness
    state = np.full(surface.shape, results.ELASTIC, dtype=np.uint8)
    state[pressure <= 0] = results.APART
    state[plastic := pressure >= hardness * (1 - 1e-9)] = results.PLASTIC
    if load.non_decreasing or math.isinf(hardness):
        before = None
    elif before is None:
        raise InvalidScene(
            f"the load path unloads, but {name} knows of no flow before its load"
        )
    lowered, touching = (
        np.zeros(surface.shape) if before is None else before,
        ~plastic & (pressure > 0),
    )
    if gap is None:
        gap = displacement - surface.heights + lowered
        level = gap.max(where=plastic, initial=gap.min())
        gap = gap - (gap[touching].mean() if touching.any() else level) - lowered
    after = np.where(plastic, np.maximum(-gap, 0.0), lowered)
    capped, left = np.where(plastic, hardness, np.maximum(pressure, 0)), gap + lowered
    rms, energy = (
        float(np.std(surface.heights)) or 1.0,
        float(np.vdot(pressure, displacement)),
    )
    residuals = {
        "gap_elastic": float(np.abs(left[touching]).max(initial=0.0)) / rms,
        "force": abs(float(pressure.mean()) - load.final)
        / (load.final or max(load.path)),
    }
    bounded = replace(scene, material=replace(scene.material, hardness=hardness))
    # The errors of a solve's gaps are far below a thousandth of the rms height.
    if (
        not touching.any()
        and left[state == results.APART].min(initial=0.0) < -1e-3 * rms
    ):
        raise NotConverged(
            "pressures of 0 or the cap, but open points lie below plastic ones"
        )
    areas, found = areas_and_quantities(
        bounded, capped, left, energy / pressure.size / 2, before, after
    )
    found["largest_pressure"] = float(pressure.max())
    if flows:  # what a surface shows of a body that flows inside
        found = {
            n: found[n] for n in ("mean_gap", "mean_separation", "largest_pressure")
        }
    fields = {
        "pressure": pressure,
        "gap": gap,
        "displacement": displacement,
        "state": state,
    }
    last = LoadStep(load.final, areas, residuals, quantities=found)
    last = last.with_errors(surface.treatment_errors, "treatment")
    return ContactResult(
        method=name,
        steps=(*(LoadStep(earlier, {}) for earlier in load.path[:-1]), last),
        provenance=Provenance(scene.digest, surface.seed, {"solver": name}),
        distribution=pressure_distribution(capped, hardness),
        fields={"heights": surface.heights, "plastic_displacement": after} | fields,
        cost={"seconds": seconds, "unknowns": pressure.size},
        notes=(
            *surface.notes,
            f"the pressure is {name}'s, everything else follows from it here",
        ),
    )
