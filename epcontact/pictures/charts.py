"""Charts of a scene and of its results in memory."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from epcontact import persson
from epcontact.harness.solving.method_results import load_rows
from epcontact.output.charts.curves import (
    DENSITY,
    PRESSURE,
    pressure_distribution,
    residual_history,
)
from epcontact.output.charts.figures import Chart, Charts
from epcontact.output.charts.maps import map_of
from epcontact.output.charts.plot import Axis, Plot, draw_table
from epcontact.output.charts.style import PART_COLOURS
from epcontact.pictures.loads import load_charts
from epcontact.results import ContactResult
from epcontact.scene import Scene, Surface, require_kind
from epcontact.surfaces.power_spectrum import radial_spectrum
from epcontact.surfaces.spectrum import density

#: The results of each method, by its name: one for each surface.
Results = Mapping[str, Sequence[ContactResult]]

#: A surface with fewer rings of wave numbers, such as a sinusoid, has no spectrum that
#: a chart could show.
_FEWEST_RINGS = 4
#: Rings with less than this fraction of the largest density are rounding noise.
_NOISE = 1e-12
_MAGNIFICATION, _AREA = "magnification", "area_fraction"


def plot(scene: Scene, *results: ContactResult) -> Charts:
    """Draw what `epcontact run --charts` draws; a notebook shows all charts.

    Args:
        scene: the scene.
        results: results of the scene by any methods.  Several results of one method, on
            other surfaces, are drawn as their mean with an interval.

    Returns:
        Charts by name: "power-spectrum", "pressure-distribution", "residuals",
        "loads-areas" and others of a path, and a map "contact-METHOD" of each first
        result with fields.  `save` writes one to files.

    Raises:
        InvalidScene: if an argument is not a `Scene`, or a later one no
            `ContactResult`.

    Example:
        >>> from epcontact import Load, Material, Surface, bem
        >>> wave = Surface(np.cos(2 * np.pi * np.arange(64) / 64), (50.0,))
        >>> scene = Scene(wave, Material(1.0, 0.0), Load((0.01, 0.02)))
        >>> charts = plot(scene, bem.solve(scene))
        >>> list(charts)[2:]
        ['loads-areas', 'loads-gap', 'contact-bem']
    """
    require_kind("scene", scene, Scene)
    by_method: dict[str, list[ContactResult]] = {}
    for result in results:
        require_kind("result", result, ContactResult)
        by_method.setdefault(result.method, []).append(result)
    hardness = scene.material.hardness
    charts = Charts()
    spectrum = spectrum_chart(scene.surface)
    if spectrum is not None:
        charts["power-spectrum"] = spectrum
    charts.update(charts_of_results(by_method, hardness))
    for method, (first, *_) in by_method.items():
        if {"state", "pressure", "gap"} <= first.fields.keys():
            caption = f"Contact state and pressure by {method}."
            chart = map_of(first.fields, scene.surface.spacing, hardness, caption)
            charts[f"contact-{method}"] = chart
    return charts


def charts_of_results(results: Results, hardness: float = math.inf) -> dict[str, Chart]:
    """Draw the charts that need nothing but results.

    Args:
        results: the results of one scene, by method; each method has at least one.
        hardness: the hardness (Pa) of the scene, infinite for none.  The hardness that
            the results themselves state takes precedence.

    Returns:
        Charts by name: "pressure-distribution" if a result has one, "residuals" if a
        method iterates, and "loads-QUANTITY" for methods with several loads.
    """
    charts: dict[str, Chart] = {}
    all_results = [*itertools.chain.from_iterable(results.values())]
    # A path that ends at no load has no pressures at its end.
    if any(r.distribution and r.final.mean_pressure > 0 for r in all_results):
        stated_hardness = all_results[0].provenance.about.get("hardness")
        if stated_hardness is not None:
            hardness = float(stated_hardness["value"])
        theory = theory_densities(results, hardness)
        chart = pressure_distribution(results, hardness=hardness, theory=theory)
        charts["pressure-distribution"] = chart
    histories = _longest_histories(results)
    if any(np.any(np.isfinite(each) & (each > 0)) for each in histories.values()):
        charts["residuals"] = residual_history(histories)
    rows = {
        method: load_rows(each)
        for method, each in results.items()
        if len(each[0].steps) > 1
    }
    if rows:
        charts |= load_charts(rows)
    return charts


def _longest_histories(results: Results) -> dict[str, np.ndarray]:
    """Return the longest history of residuals of each method that iterates.

    One chart with the histories of all surfaces would be illegible.

    Args:
        results: the results of each method, by its name: one for each surface.

    Returns:
        The dimensionless residual after each iteration, shape (iterations,), by method.
    """
    histories = {}
    for method, each in results.items():
        longest = max((result.history for result in each), key=len)
        if len(longest) > 0:
            histories[method] = np.array(longest)
    return histories


def theory_densities(results: Results, hardness: float) -> pd.DataFrame | None:
    """Return the pressure densities of the theory by its formulas.

    Args:
        results: the results by method; "persson" has the diffusion and the load.
        hardness: the hardness (Pa).  If it is finite, the density without hardness at
            the same diffusion is added.

    Returns:
        A table with the columns series, PRESSURE and DENSITY, for
        `pressure_distribution`; None if the theory has no result or the surface has no
        roughness.
    """
    if not results.get("persson"):
        return None
    final = results["persson"][0].final
    diffusion = final.quantities.get("diffusion", 0.0)
    if not diffusion > 0:
        return None
    curve = persson.pressure_curve(diffusion, final.mean_pressure, hardness)
    tables = [_curve("persson", PRESSURE, curve.pressure, DENSITY, curve.density)]
    if math.isfinite(hardness):
        pressure = np.linspace(0.0, 1.04 * hardness, 300)
        elastic = persson.pressure_density(pressure, diffusion, final.mean_pressure)
        name = "persson without hardness"
        tables.append(_curve(name, PRESSURE, pressure, DENSITY, elastic))
    return pd.concat(tables)


def _curve(name: str, x: str, x_values: Any, y: str, y_values: Any) -> pd.DataFrame:
    """Return a table of one curve of a chart.

    Args:
        name: the name of the curve, the value of the column "series".
        x, y: the names of the two other columns, with units.
        x_values, y_values: the numbers of these columns, shape (points,).
    """
    return pd.DataFrame({"series": name, x: x_values, y: y_values})


def spectrum_chart(surface: Surface) -> Chart | None:
    """Draw Figure 2 of the paper: the power spectrum of a surface or line.

    If the surface was generated from an analytic spectrum, that spectrum is a curve of
    the chart.

    Args:
        surface: a surface or line with its heights.

    Returns:
        The chart over the wave number (rad/m); None if fewer than four wave numbers
        have roughness, because a few dots show no spectrum.
    """
    spectrum = radial_spectrum(surface)
    drawn = spectrum.density > _NOISE * spectrum.density.max()
    if np.count_nonzero(drawn) < _FEWEST_RINGS:
        return None
    dimension = surface.heights.ndim
    # The density of a line is the one-dimensional C1 in m^3, that of a surface C in
    # m^4.
    symbol, power = "C", 4
    if dimension == 1:
        symbol, power = "C_1", 3
    x, y = "wavenumber_rad_per_m", f"density_m{power}"
    wavenumbers, densities = spectrum.wavenumber[drawn], spectrum.density[drawn]
    tables = [_curve("surface", x, wavenumbers, y, densities)]
    analytic = surface.spectrum
    if analytic is not None:
        waves = np.geomspace(analytic.wavenumber_low, analytic.wavenumber_high, 300)
        tables.append(
            _curve("analytic", x, waves, y, density(analytic, waves, dimension))
        )
    look = Plot(
        Axis(x, r"wave number $q$ (rad/m)"),
        Axis(y, rf"spectral density ${symbol}(q)$ (m$^{power}$)"),
        styles={"analytic": "curve"},
        log="xy",
        title="Which wavelengths make the surface rough?",
    )
    caption = "Power spectrum of the surface roughness."
    return draw_table(pd.concat(tables), look, caption)


def magnification_chart(
    case_id: str,
    areas: persson.MagnificationCurve,
    bem_results: Sequence[ContactResult],
    energy_reduction: float,
) -> Chart:
    """Draw Figure 4 of the paper: contact areas against the magnification.

    Args:
        case_id: the id of the case, for the caption.
        areas: the areas of the theory, fractions of the nominal area.
        bem_results: the results of the boundary elements; the means of their areas are
            points at the largest magnification.
        energy_reduction: gamma, the dimensionless factor of the theory's elastic
            energy, for the caption.

    Returns:
        The chart; its data have the columns series, magnification, area_fraction, low
        and high.
    """
    parts = ("total", "elastic", "plastic")
    curves: dict[str, Any] = {part: getattr(areas, part) for part in parts}
    theory = pd.DataFrame({_MAGNIFICATION: areas.magnification} | curves)
    # A user's solver that replaces the boundary elements need not have these areas.
    finals = [result.final.areas for result in bem_results]
    corrected = [vars(each["corrected"]) for each in finals if "corrected" in each]
    points = pd.DataFrame(corrected, columns=parts).mean().to_frame().T
    points[_MAGNIFICATION] = areas.magnification.max()
    table = pd.concat(
        [
            _by_part(theory).assign(method="", style="curve"),
            _by_part(points).assign(method="bem"),
        ]
    )
    largest = table.groupby(["part", "method"])[_AREA].transform("max")
    table = table[largest > 0]
    # Areas vanish exponentially at low magnification and would squeeze everything else,
    # so the axis ends three decades below the largest area.
    positive = table[_AREA][table[_AREA] > 0]
    lowest = max(0.7 * positive.min(), 1e-3 * positive.max())
    look = Plot(
        Axis(_MAGNIFICATION, r"magnification $\zeta = q / q_0$ (–)"),
        Axis(_AREA, r"contact area $A / A_0$ (–)"),
        series=("part", "method"),
        colour="part",
        colours=PART_COLOURS,
        log="xy",
        limits={"ylim": (lowest, 1.5 * positive.max())},
        title="On which length scale does the contact begin to flow?",
    )
    caption = (
        f"{case_id}: areas against magnification by Persson's theory, "
        f"gamma = {energy_reduction:g}; points: the boundary elements, in the "
        "continuum limit."
    )
    return draw_table(table, look, caption)


def _by_part(table: pd.DataFrame) -> pd.DataFrame:
    """Return areas by magnification as a table with one area in a row.

    Args:
        table: a row for each magnification, with the columns "magnification", "total",
            "elastic" and "plastic" (fractions of the nominal area).

    Returns:
        A table with the columns "magnification", "part" (the name of the area) and
        "area_fraction".
    """
    return table.melt(_MAGNIFICATION, var_name="part", value_name=_AREA)
