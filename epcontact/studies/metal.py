"""The study of a J2 metal beside the capped theory: areas, gap and what a load leaves.

A J2 body has no largest contact pressure.  The theory and boundary elements need one,
the hardness.  The study solves J2 bodies by finite elements and compares them with the
theory and with boundary elements at the hardness of the package's map, and with the
theory at Tabor's three yield stresses.

The plastic area of a body with a hardness is where the pressure is the hardness.  For a
J2 body two areas come near this: the contact on material that has flowed, and the
contact pressed with at least the hardness of the model with which it is compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import fem_check
from epcontact.crosscheck.model_difference import capped_body, elements_compliance
from epcontact.materials.hardness_map import effective_hardness
from epcontact.output.charts.figures import logarithmic, new_figure, styled
from epcontact.output.charts.style import CYCLE, MARKERS, typeset
from epcontact.persson import separation
from epcontact.results import ContactResult, FloatArray, LoadStep
from epcontact.scene import Body, Load, Scene, Surface
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    mean_with_interval,
    study,
    tabulate,
)
from epcontact.studies.hardness import model_scene
from epcontact.studies.paper_scene import TABOR, solve_theory, theory_of
from epcontact.surfaces import power_by_octave, residual_surface
from fem_check.result import contact_result

#: Mean pressures over the yield stress.
LOADS = (0.1, 0.25, 0.5, 1.0)
POISSON_RATIO = 0.3
#: Ratio of the half-width of a 95 % interval to an error estimate of an area, which
#: nine of ten errors do not exceed: two quantiles of a normal distribution.
_INTERVAL_OF_ESTIMATE = 1.19
#: The compared models, each with the line and the size of the mark of its curves.
MODELS: dict[str, tuple[Any, float]] = {
    "theory, hardness of the map": ("-", 4.5),
    "boundary elements, hardness of the map": (":", 4.5),
    "theory, 3 sigma_Y": ("--", 0.0),
}
#: The compared quantities, with the titles of their panels.
QUANTITIES = {
    "area": "contact area\n(of that of J2)",
    "flowed": "plastic area, flowed metal\n(of the contact area)",
    "pressed": "plastic area, at the hardness\n(of the contact area)",
    "gap": "mean gap\n(of that of J2)",
    "rms_height": "rms height left\n(of that before)",
    "shortest": "power left, shortest octave\n(of that before)",
}


class _Response(NamedTuple):
    """What a model says of one body under one load, all dimensionless but the gap.

    Attributes:
        area: contact area over the nominal area.
        plastic: plastic area over the nominal area.
        gap: mean gap, in m.
        rms_height: rms height after unloading over that before; NaN: not predicted.
        shortest: height variance of the shortest octave of wave numbers after unloading
            over that before.
    """

    area: float
    plastic: float
    gap: float
    rms_height: float
    shortest: float


@study(
    "metal",
    severities=(3.0, 5.0, 15.0, 50.0),
    seeds=range(101, 105),
    nodes_per_wavelength=12,
    waves=8,
)
def metal(
    say: Say,
    severities: Sequence[float] = (5.0, 50.0),
    seeds: Ints = (101, 102),
    nodes_per_wavelength: int = 6,
    waves: int = 4,
) -> Charts:
    """Errors of the theory and of boundary elements that replace a J2 metal by a cap.

    The cap is the hardness of the package's map or Tabor's 3 sigma_Y; nu = 0.3, gamma =
    0.536, the spectrum of the same surfaces.  Finite elements are unloaded after each
    load.  Panels: error of the area and of the gap over those of J2; difference of
    plastic areas over the contact area of J2, whose plastic area is the contact on
    metal that has flowed, or the contact pressed with at least the model's hardness;
    differences of what is left of rms height and of the shortest octave's power after
    unloading.
    """

    def rows(severity: float, seed: int) -> Rows:
        """Return the rows of `compare` for one body."""
        nodes = nodes_per_wavelength * waves
        return compare(model_scene(severity, POISSON_RATIO, seed, nodes, waves))

    table = tabulate(say, rows, severity=severities, seed=seeds)
    by = ["model", "load", "severity", "quantity"]
    means = mean_with_interval(table, "error", by, shared_error="error_of_grid")
    names = {"error_low": "low", "error_high": "high"}
    columns = ["model", "load", "error", "low", "high", "severity", "quantity"]
    count = len(seeds)
    caption = (
        "How wrong are the theory and boundary elements for a J2 metal? Means of "
        f"{count} surfaces with their 95 % intervals."
    )
    yield draw, means.rename(columns=names)[columns], caption


def mapped_hardness(scene: Scene) -> float:
    """Return the hardness in Pa that the package's map gives for a scene.

    Args:
        scene: A self-affine surface, a J2 material and a load, whose last value counts.

    Raises:
        InvalidScene: The scene is outside the map, or its contact is too full for a
            hardness.
    """
    material = scene.material
    spectrum = scene.surface.spectrum
    assert spectrum is not None
    mapped = effective_hardness(
        yield_stress=material.yield_stress,
        young_modulus=material.young_modulus,
        poisson_ratio=material.poisson_ratio,
        rms_slope=spectrum.rms_slope,
        mean_pressure=scene.load.final,
        breadth=spectrum.wavenumber_high / spectrum.wavenumber_roll_off,
    )
    return mapped.value


def compare(scene: Scene) -> Rows:
    """Return a row for each load of LOADS, model of MODELS and quantity of QUANTITIES.

    Columns: load over the yield stress, model, quantity, error (a fraction), and
    error_of_grid, the half-width of the 95 % interval of the J2 body's own area.

    Args:
        scene: A self-affine surface and a J2 material; body, load and hardness are not
            used, because the body is a half-space without a cap.
    """
    yield_stress = scene.material.yield_stress
    elastic = replace(scene.material, hardness=math.inf)
    # The surface is unloaded after each load, which changes no later load.
    loads = [load * yield_stress for load in LOADS]
    path = Load(tuple(np.ravel([[load, 0.0] for load in loads])))
    body = replace(scene, material=elastic, body=Body(), load=path)
    solved = fem_check.solve_path(body, law="j2", certified=False, tolerance=1e-4)
    j2 = contact_result(solved)
    compliance = elements_compliance(body, j2)
    rows = []
    for k, load in enumerate(loads):
        single = replace(body, load=Load(load))
        pressed, unloaded = solved.points[2 * k : 2 * k + 2]
        step = j2.steps[2 * k]
        left = replace(scene.surface, heights=-unloaded.gap)
        flowed = _response(step, scene.surface, left)
        pressures = pressed.state.forces / solved.problem.block.node_area
        mapped = mapped_hardness(single)
        theories = {
            "theory, hardness of the map": mapped,
            "theory, 3 sigma_Y": TABOR * yield_stress,
        }
        responses = {}
        for model, hardness in theories.items():
            capped = replace(elastic, hardness=hardness)
            responses[model] = _by_theory(replace(single, material=capped)), hardness
        by_boundary = capped_body(single, mapped, compliance)
        responses["boundary elements, hardness of the map"] = (
            _by_boundary(by_boundary, scene.surface),
            mapped,
        )
        of_grid = _INTERVAL_OF_ESTIMATE * step.areas["error"].total / flowed.area
        for model, (response, hardness) in responses.items():
            at_hardness = float((pressures >= hardness).mean())
            errors = _errors(response, flowed, at_hardness)
            for quantity, error in errors.items():
                row = {"load": LOADS[k], "model": model, "quantity": quantity}
                shared = of_grid if quantity == "area" else 0.0
                rows.append(row | {"error": error, "error_of_grid": shared})
    return rows


def _response(step: LoadStep, before: Surface, after: Surface) -> _Response:
    """Return the response of a numerical model.

    Args:
        step: Its result at the load.
        before: The surface before the load.
        after: The surface after unloading.
    """
    areas = step.areas["corrected"]
    shortest = _shortest_octave(before)
    left = power_by_octave(after)[1][shortest] / power_by_octave(before)[1][shortest]
    return _Response(
        area=areas.total,
        plastic=areas.plastic,
        gap=step.quantities["mean_gap"],
        rms_height=after.rms_height / before.rms_height,
        shortest=float(left),
    )


def _by_boundary(result: ContactResult, surface: Surface) -> _Response:
    """Return the response of boundary elements, from a result on a surface."""
    return _response(result.final, surface, residual_surface(surface, result))


def _by_theory(scene: Scene) -> _Response:
    """Return the response of the theory at the hardness of a scene."""
    step = solve_theory(scene).final
    left = power_kept_by_theory(scene)
    _, before = power_by_octave(scene.surface)
    shortest = _shortest_octave(scene.surface)
    before = before[: shortest + 1]
    variance_left = float((left[: shortest + 1] * before).sum() / before.sum())
    return _Response(
        area=step.areas["corrected"].total,
        plastic=step.areas["corrected"].plastic,
        gap=step.quantities["mean_gap"],
        rms_height=math.sqrt(variance_left),
        shortest=float(left[shortest]),
    )


def power_kept_by_theory(scene: Scene) -> FloatArray:
    """Return the slope variance after a load over that before, for each octave.

    It follows from the theory's effective spectrum under the load of the scene.  The
    shape is (octaves,), from the longest waves on.
    """
    theory = theory_of(scene)
    before = theory.roughness
    after = separation.flattened(theory, scene.load.final).roughness
    lowest = 2 * math.pi / max(scene.surface.periods)
    octave = np.floor(np.log2(before.upper_edge / lowest)).astype(int)
    variance_after = np.bincount(octave, after.slope_variance)
    variance_before = np.bincount(octave, before.slope_variance)
    return np.asarray(variance_after / variance_before)


def _shortest_octave(surface: Surface) -> int:
    """Return the index of the octave that ends at the shortest wave of a surface."""
    assert surface.shortest_wavelength is not None
    return round(math.log2(max(surface.periods) / surface.shortest_wavelength)) - 1


def _errors(
    response: _Response, of_j2: _Response, at_hardness: float
) -> dict[str, float]:
    """Return the errors of a model by the names of QUANTITIES, as fractions.

    Args:
        response: Of the model.
        of_j2: Of the J2 body.
        at_hardness: Area of the J2 body's contact that is pressed with at least the
            model's hardness, over the nominal area.
    """
    return {
        "area": response.area / of_j2.area - 1,
        "flowed": (response.plastic - of_j2.plastic) / of_j2.area,
        "pressed": (response.plastic - at_hardness) / of_j2.area,
        "gap": response.gap / of_j2.gap - 1,
        "rms_height": response.rms_height - of_j2.rms_height,
        "shortest": response.shortest - of_j2.shortest,
    }


def draw(table: pd.DataFrame) -> Any:
    """Return a matplotlib figure with a panel for each quantity.

    `table` has the columns of the study: model, load, error with its interval (low,
    high), severity and quantity.  Errors are drawn in per cent.
    """
    severities = sorted(table["severity"].unique())
    colours = dict(zip(severities, CYCLE, strict=False))
    marks = dict(zip(severities, MARKERS, strict=False))
    with styled():
        figure, _ = new_figure(7.6, 6.4)
        figure.clear()
        panels = figure.subplots(2, 3, sharex=True)
        for axes, (quantity, title) in zip(
            panels.flat, QUANTITIES.items(), strict=True
        ):
            rows = table[table["quantity"] == quantity]
            for (model, severity), curve in rows.groupby(["model", "severity"]):
                line, size = MODELS[str(model)]
                _draw_curve(
                    axes,
                    curve,
                    linestyle=line,
                    markersize=size,
                    marker=marks[severity],
                    color=colours[severity],
                )
            axes.axhline(0, color="black", linewidth=0.8)
            axes.set_title(title)
            logarithmic(axes, "x")
            axes.set_xticks(LOADS, [f"{load:g}" for load in LOADS])
        for axes in panels[-1]:
            axes.set_xlabel(typeset("p0 / sigma_Y (–)"))
        for axes in panels[:, 0]:
            axes.set_ylabel("error (%)")
        _add_legend(figure, colours, marks)
    return figure


def _draw_curve(axes: Any, curve: pd.DataFrame, **look: Any) -> None:
    """Draw the errors of one model and severity over the load, with their intervals.

    Args:
        axes: The matplotlib axes.
        curve: Rows of the table, in the order of the loads.
        look: Line, mark and colour.
    """
    y = 100 * curve["error"].to_numpy()
    bars: FloatArray = np.abs(100 * curve[["low", "high"]].to_numpy().T - y)
    if not look["markersize"]:
        bars = np.zeros_like(bars)
    axes.errorbar(curve["load"], y, bars, elinewidth=0.8, linewidth=1.0, **look)


def _add_legend(
    figure: Any, colours: Mapping[float, str], marks: Mapping[float, str]
) -> None:
    """Add the legend of severities and models to a figure.

    `colours` and `marks` are those of each severity.
    """
    from matplotlib.lines import Line2D

    handles = []
    for severity, colour in colours.items():
        label = typeset(f"E* xi / sigma_Y = {severity:g}")
        handles.append(
            Line2D([], [], color=colour, marker=marks[severity], label=label)
        )
    for model, (line, _) in MODELS.items():
        label = typeset(model)
        handles.append(Line2D([], [], color="black", ls=line, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
