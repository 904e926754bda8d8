"""What `epcontact run` draws of a case: the theory's curves and the methods' distributions.

    power-spectrum          of the first surface, and the analytic one
    persson-magnification   areas against magnification, with the areas another method found
    persson-pressure        P(sigma) of the theory as a table
    pressure-distribution   P(sigma) of every method on one axis

Each is a picture (.png, .svg), its data (.csv, .json) and a caption (.txt).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.harness.case import Case
from epcontact.harness.run import Answer
from epcontact.output.files import write_bytes, write_json
from epcontact.results import FloatArray
from epcontact.scene import Scene, Surface


def write_pictures(case: Case, answers: Mapping[str, Answer], folder: Path) -> list[Path]:
    """Draw what the answers allow into `folder`; returns the files written.

    Raises OutputError.
    """
    scene = case.scene(case.recipes[0])
    theory = answers.get("persson", Answer()).results
    curves = _theory_curves(scene, case.options["persson"]) if theory else {}
    written: list[Path] = []
    for name, chart in _charts(case, scene, answers, curves).items():
        written += chart.save(folder / name)
    for name, curve in curves.items():
        path = folder / f"persson-{name}.json"
        write_json(path, {key: list(column) for key, column in curve.columns().items()})
        written.append(path)
    return written


def _theory_curves(scene: Scene, options: Mapping[str, Any]) -> dict[str, Any]:
    from epcontact import persson

    return {
        "magnification": persson.scene_magnification_curve(scene, **options),
        "pressure": persson.scene_pressure_curve(scene, **options),
    }


def _spectrum_chart(surface: Surface) -> Any:
    """The paper's Fig. 2: the spectrum of the first surface, over the one it was drawn from."""
    from epcontact.output.charts.curves import power_spectrum
    from epcontact.output.charts.figures import Series
    from epcontact.surfaces.power_spectrum import radial_spectrum
    from epcontact.surfaces.spectrum import density

    found = radial_spectrum(surface)
    shown = found.density > 1e-12 * found.density.max()
    series = [Series("surface", found.wavenumber[shown], found.density[shown])]
    analytic, dimension = surface.spectrum, surface.heights.ndim
    if analytic is not None:
        q = np.geomspace(analytic.wavenumber_low, analytic.wavenumber_high, 300)
        series.append(Series("analytic", q, density(analytic, q, dimension), line=True))
    return power_spectrum(series, line=dimension == 1)


def _charts(
    case: Case, scene: Scene, answers: Mapping[str, Answer], curves: Mapping[str, Any]
) -> dict[str, Any]:
    from epcontact.output.charts.curves import areas_against_magnification, pressure_distribution
    from epcontact.output.charts.figures import Series

    charts: dict[str, Any] = {"power-spectrum": _spectrum_chart(scene.surface)}
    series, plastic = [], {}
    found = {m: a for m, a in answers.items() if a.results and a.results[0].distribution}
    if curves:
        areas, pressure = curves["magnification"], curves["pressure"]
        zeta = areas.magnification
        parts = {"total": areas.total, "elastic": areas.elastic, "plastic": areas.plastic}
        gamma = case.options["persson"]["energy_reduction"]
        charts["persson-magnification"] = areas_against_magnification(
            [Series(name, zeta, area) for name, area in parts.items() if np.any(area > 0)],
            points=_mean_areas(found),
            caption=f"{case.id}: areas against magnification by Persson's theory, "
            f"gamma = {gamma:g}; points: the boundary elements, in the continuum limit.",
        )
        series.append(Series("persson", pressure.pressure, pressure.density, line=True))
        plastic["persson"] = pressure.plastic
    for method in [m for m in found if m != "persson"]:
        sigma, density = _mean_density(found[method])
        series.append(Series(method, sigma, density))
        plastic[method] = float(np.mean([_plastic(r) for r in found[method].results]))
    if series:
        charts["pressure-distribution"] = pressure_distribution(
            series,
            mean_pressure=case.load.final,
            hardness=case.material.hardness,
            plastic=plastic,
        )
    return charts


def _plastic(result: Any) -> float:
    return float(result.distribution.plastic)


def _mean_areas(found: Mapping[str, Answer]) -> dict[str, float]:
    if "bem" not in found:
        return {}
    # A solver of the user's in the place of bem need not have corrected areas.
    results = [r for r in found["bem"].results if "corrected" in r.final.areas]
    if not results:
        return {}
    parts = ("total", "elastic", "plastic")
    means = {p: [getattr(r.final.areas["corrected"], p) for r in results] for p in parts}
    return {f"{p}, bem": float(np.mean(v)) for p, v in means.items() if np.any(np.array(v) > 0)}


def _mean_density(answer: Answer) -> tuple[FloatArray, FloatArray]:
    """P(sigma) averaged over the surfaces, in common bins."""
    from epcontact.output.charts.curves import pressure_density

    tables = [r.distribution for r in answer.results if r.distribution is not None]
    largest = max(float(t.pressure[-1]) for t in tables)
    densities = [pressure_density(t, largest=largest) for t in tables]
    return densities[0][0], np.mean([density for _, density in densities], axis=0)


def save_map(source: Path, target: Path) -> None:
    """Draw contact state and pressure of a .vti file to `target`: PNG alone, if it ends so.

    Raises OutputError.
    """
    from epcontact.output.charts.maps import map_of_file

    chart = map_of_file(source)
    if target.suffix == ".png":
        write_bytes(target, chart.png())
    else:
        chart.save(target)
