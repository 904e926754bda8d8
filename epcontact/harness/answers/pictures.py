"""The charts of a case: the theory's curves and the distributions of all its methods.

    power-spectrum          of the first surface, and the analytic one
    persson-magnification   areas against magnification, with the areas of the boundary elements
    persson-pressure        P(sigma) of the theory as a table
    pressure-distribution   P(sigma) of every method on one axis

Each is a picture (.png, .svg), its data (.csv, .json) and a caption (.txt).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from epcontact import persson
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import Case
from epcontact.output.charts.curves import (
    areas_against_magnification,
    power_spectrum,
    pressure_distribution,
)
from epcontact.output.charts.figures import Chart, Series
from epcontact.output.files import write_json
from epcontact.results import ContactResult
from epcontact.scene import Surface
from epcontact.surfaces.power_spectrum import radial_spectrum
from epcontact.surfaces.spectrum import density

#: Fewest rings of wave numbers that make a spectrum.
FEWEST_RINGS = 4

Results = Mapping[str, Sequence[ContactResult]]


def write_pictures(case: Case, answers: Mapping[str, Answer], folder: Path) -> list[Path]:
    """Draw the charts that the answers allow.

    Args:
        case: The case that was answered.
        answers: The answers by method.
        folder: The folder for the files.

    Returns:
        The files written.

    Raises:
        OutputError: If a file cannot be written.
    """
    scene = case.scene(case.recipes[0])
    results = {method: answer.results for method, answer in answers.items() if answer.results}
    hardness = case.material.hardness
    spectrum = _spectrum_chart(scene.surface)
    charts = {} if spectrum is None else {"power-spectrum": spectrum}
    tables = {}
    if "persson" in results:
        options = case.options["persson"]
        body = persson.Theory.of_scene(scene, **options)
        areas = body.magnification_curve(scene.load.final)
        charts["persson-magnification"] = _magnification_chart(case, areas, results)
        tables["persson-magnification"] = areas.columns()
        tables["persson-pressure"] = body.pressure_curve(scene.load.final).columns()
    if any(result.distribution for found in results.values() for result in found):
        theory = theory_densities(results, hardness)
        charts["pressure-distribution"] = pressure_distribution(
            results, hardness=hardness, theory=theory
        )
    written = [path for name, chart in charts.items() for path in chart.save(folder / name)]
    for name, columns in tables.items():
        path = folder / f"{name}.json"
        write_json(path, {key: list(column) for key, column in columns.items()})
        written.append(path)
    return written


def theory_densities(results: Results, hardness: float) -> list[Series]:
    """Return the theory's densities by formula, for the chart of all methods' pressures.

    Args:
        results: The results by method.
        hardness: In Pa; if it is finite, the density without hardness is added, at the same
            diffusion.

    Returns:
        One or two series, or none if the theory has no result or the surface has no roughness.

    Example:
        >>> theory_densities({}, hardness=1.0)
        []
    """
    found = results.get("persson", ())
    diffusion = found[0].final.quantities.get("diffusion", 0.0) if found else 0.0
    if not diffusion > 0:
        return []
    p0 = found[0].final.mean_pressure
    curve = persson.pressure_curve(diffusion, p0, hardness)
    series = [Series("persson", curve.pressure, curve.density, line=True)]
    if math.isfinite(hardness):
        sigma = np.linspace(0.0, 1.04 * hardness, 300)
        elastic = persson.pressure_density(sigma, diffusion, p0)
        series.append(Series("persson without hardness", sigma, elastic, line=True))
    return series


def _spectrum_chart(surface: Surface) -> Chart | None:
    """Chart the spectrum of the surface and the analytic one that it was drawn from.

    A surface of a few waves, such as a sinusoid, has no chart: a few dots show no spectrum.
    """
    spectrum = radial_spectrum(surface)
    shown = spectrum.density > 1e-12 * spectrum.density.max()
    if np.count_nonzero(shown) < FEWEST_RINGS:
        return None
    series = [Series("surface", spectrum.wavenumber[shown], spectrum.density[shown])]
    analytic, dimension = surface.spectrum, surface.heights.ndim
    if analytic is not None:
        q = np.geomspace(analytic.wavenumber_low, analytic.wavenumber_high, 300)
        series.append(Series("analytic", q, density(analytic, q, dimension), line=True))
    return power_spectrum(series, line=dimension == 1)


def _magnification_chart(case: Case, areas: persson.MagnificationCurve, results: Results) -> Chart:
    """Chart the theory's areas, with the mean areas of the boundary elements as points."""
    parts = {"total": areas.total, "elastic": areas.elastic, "plastic": areas.plastic}
    steps = [result.final for result in results.get("bem", ())]
    # A user's solver that replaces bem need not have corrected areas.
    corrected = [step.areas["corrected"] for step in steps if "corrected" in step.areas]
    means = {p: float(np.mean([getattr(a, p) for a in corrected] or [0.0])) for p in parts}
    gamma = case.options["persson"]["energy_reduction"]
    return areas_against_magnification(
        [Series(p, areas.magnification, area) for p, area in parts.items() if np.any(area > 0)],
        points={f"{p}, bem": mean for p, mean in means.items() if mean > 0},
        caption=f"{case.id}: areas against magnification by Persson's theory, gamma = {gamma:g}; "
        "points: the boundary elements, in the continuum limit.",
    )
