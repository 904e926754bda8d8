"""The result that follows from a pressure field, in the same way for every code.

A gate then judges the pressures of a code and no other output of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact import results
from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.driver import areas_and_quantities
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Scene

#: A pressure this close to the hardness, relative to it, counts as the hardness.
_AT_HARDNESS = 1e-9
#: Depth, over the rms height, by which an open point may penetrate the flat.  Errors of
#: the gaps of a converged solve are far smaller.
_OPEN_BELOW = 1e-3


def result_of_pressures(
    scene: Scene,
    given: Mapping[str, Any],
    name: str,
    seconds: float = 0.0,
    before: FloatArray | None = None,
    flows: bool = False,
) -> ContactResult:
    """Return the result at the last load that follows from a pressure field.

    Points with zero pressure are apart, those at the hardness are plastic, and all
    others are elastic.  The residuals of the result are "gap_elastic", the largest gap
    of an elastic point over the rms height, and "force", the relative error of the mean
    pressure.

    Args:
        scene: the scene that was solved.
        given: the fields of the solver on the grid of the scene: "pressure" in Pa;
            "gap" and "displacement" in m follow from it if they are not given.  The
            flat is then where the mean gap of the elastic points vanishes or, if there
            is no elastic point, at the highest plastic one.
        name: the name of the solver.
        seconds: the time of its solve.
        before: plastic displacement (m, downward) that earlier loads left, on the grid;
            None: none.
        flows: whether the body flows by J2, so that no cap bounds the pressures.

    Raises:
        InvalidScene: if a field is not finite, or if the path unloads and `before` is
            not given.
        NotConverged: if all contact is plastic and an open point lies below it.
    """
    _require_finite(given)
    surface, load, pressure = scene.surface, scene.load, given["pressure"]
    displacement, gap = given.get("displacement"), given.get("gap")
    if displacement is None:
        displacement = _displacement(scene, pressure)
    hardness = math.inf if flows else scene.material.hardness
    plastic = pressure >= hardness * (1 - _AT_HARDNESS)
    elastic = ~plastic & (pressure > 0)
    state = np.full(surface.shape, results.ELASTIC, dtype=np.uint8)
    state[pressure <= 0] = results.APART
    state[plastic] = results.PLASTIC
    if load.non_decreasing or math.isinf(hardness):
        before = None
    elif before is None:
        raise InvalidScene(
            f"the load path unloads, but {name} gives no plastic displacement of the "
            "earlier loads"
        )
    lowered = np.zeros(surface.shape) if before is None else before
    if gap is None:
        gap = displacement - surface.heights + lowered
        level = gap.max(where=plastic, initial=gap.min())
        if elastic.any():
            level = gap[elastic].mean()
        gap = gap - level - lowered
    plastic_displacement = np.where(plastic, np.maximum(-gap, 0.0), lowered)
    gap_to_lowered = gap + lowered
    rms_height = float(np.std(surface.heights)) or 1.0
    open_gap = gap_to_lowered[state == results.APART].min(initial=0.0)
    if not elastic.any() and open_gap < -_OPEN_BELOW * rms_height:
        raise NotConverged(
            "pressures of 0 or the cap, but open points lie below plastic ones"
        )
    gap_error = float(np.abs(gap_to_lowered[elastic]).max(initial=0.0))
    load_error = abs(float(pressure.mean()) - load.final)
    residuals = {
        "gap_elastic": gap_error / rms_height,
        "force": load_error / (load.final or max(load.path)),
    }
    bounded = np.where(plastic, hardness, np.maximum(pressure, 0))
    areas, quantities = areas_and_quantities(
        replace(scene, material=replace(scene.material, hardness=hardness)),
        bounded,
        gap_to_lowered,
        float(np.vdot(pressure, displacement)) / pressure.size / 2,
        before,
        plastic_displacement,
    )
    quantities["largest_pressure"] = float(pressure.max())
    if flows:  # other quantities depend on the flow inside of the body
        shown = ("mean_gap", "mean_separation", "largest_pressure")
        quantities = {name: quantities[name] for name in shown}
    last = LoadStep(load.final, areas, residuals, quantities=quantities)
    last = last.with_errors(surface.treatment_errors, "treatment")
    return ContactResult(
        method=name,
        steps=(*(LoadStep(earlier, {}) for earlier in load.path[:-1]), last),
        provenance=Provenance(scene.digest, surface.seed, {"solver": name}),
        distribution=pressure_distribution(bounded, hardness),
        fields={
            "heights": surface.heights,
            "plastic_displacement": plastic_displacement,
            "pressure": pressure,
            "gap": gap,
            "displacement": displacement,
            "state": state,
        },
        cost={"seconds": seconds, "unknowns": pressure.size},
        notes=(
            *surface.notes,
            f"the pressure is {name}'s, everything else follows from it here",
        ),
    )


def _require_finite(given: Mapping[str, Any]) -> None:
    """Raise InvalidScene if a field of a solver is infinite or NaN at a point.

    `given` has the fields by name: pressure and, where given, gap and displacement.
    """
    for field in ("pressure", "gap", "displacement"):
        if not np.isfinite(given.get(field, 0)).all():
            raise InvalidScene(
                f"{field} is infinite or NaN at a point, but must be finite"
            )


def _displacement(scene: Scene, pressure: FloatArray) -> NDArray[np.float64]:
    """Return the elastic surface displacement (m, downward) that pressures (Pa) cause.

    `pressure` and the result are on the grid of the scene.
    """
    surface = scene.surface
    q = rfft_wavenumbers(surface.shape, surface.periods)
    compliance = surface_compliance(q, scene.body, scene.material)
    modes = compliance * np.fft.rfftn(pressure)
    axes = range(pressure.ndim)
    return np.asarray(np.fft.irfftn(modes, s=surface.shape, axes=axes))
