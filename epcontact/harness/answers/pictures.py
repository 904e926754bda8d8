"""The pictures of a case: the theory's curves, and what the answers of all its methods
show.

    power-spectrum            of the first surface, and the analytic one
    persson-magnification     areas against magnification, with the areas of the boundary elements
    persson-pressure          P(sigma) of the theory as a table
    pressure-distribution     P(sigma) of every method on one axis
    residuals                 against the iterations of every method
    loads-QUANTITY            what each method found at every load of a path
    contact-METHOD            state and pressure of the first surface from above, and, as
                              contact-METHOD-step-NUMBER, of every load whose fields are
                              kept
    pressure-difference-A-B   the pressures of two methods on one grid, and their difference
    body-METHOD               the finite-element body, cut open

Each is a picture (.png and, but for a body, .svg), a caption (.txt) and, of charts,
data (.csv). The report shows them all.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact import persson
from epcontact.errors import OutputError
from epcontact.files import write_json, write_text
from epcontact.harness.answers.store import Answer, load_rows
from epcontact.harness.case_files.case import Case
from epcontact.output.charts.curves import (
    DENSITY,
    PRESSURE,
    pressure_distribution,
    residual_history,
)
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.maps import map_of, map_of_file, pressure_difference
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import PART_COLOURS
from epcontact.output.loads import LOAD_CHARTS, Row, load_charts
from epcontact.output.report import Pictures
from epcontact.output.view import load_steps, screenshot
from epcontact.output.vtk import read_fields
from epcontact.results import ContactResult
from epcontact.scene import Scene, Surface
from epcontact.surfaces.power_spectrum import radial_spectrum
from epcontact.surfaces.spectrum import density

_FEWEST_RINGS = 4  # of wave numbers, that make a spectrum
_MOST_CURVES = 4  # of a sweep, that a chart of three areas can show
#: Charts of the case itself, which are drawn before those of the results.
_SPECTRUM, _MAGNIFICATION = "power-spectrum", "persson-magnification"
_OF_RESULTS = ("pressure-distribution", "residuals", *LOAD_CHARTS)
_ENDINGS = (".png", ".svg", ".csv", ".txt")

Results = Mapping[str, Sequence[ContactResult]]


def write_pictures(case: Case, answers: Mapping[str, Answer], folder: Path) -> Pictures:
    """Draw the pictures of a case and of its results.

    Args:
        case: the case.
        answers: the results of its methods, by the methods' names.
        folder: the folder of its results, with the files of fields.

    Returns:
        The names of the pictures, and why some could not be drawn.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    scene = case.scene(case.recipes[0])
    results = {
        method: answer.results for method, answer in answers.items() if answer.results
    }
    if (spectrum := _spectrum_chart(scene.surface)) is not None:
        spectrum.save(folder / _SPECTRUM)
    if "persson" in results:
        theory = persson.Theory.of_scene(scene, **case.options["persson"])
        areas = theory.magnification_curve(scene.load.final)
        pressures = theory.pressure_curve(scene.load.final)
        chart = _magnification_chart(case, areas, results)
        chart.save(folder / _MAGNIFICATION)
        for name, curve in (("magnification", areas), ("pressure", pressures)):
            columns = {key: list(values) for key, values in curve.columns().items()}
            write_json(folder / f"persson-{name}.json", columns)
    return _draw_results(results, folder)


def draw_saved(case_id: str, answers: Mapping[str, Any], folder: Path) -> Pictures:
    """Draw the pictures of results that were read from files.

    Args:
        case_id: the id of the case, for messages.
        answers: the content of the JSON file of each method, by the methods' names.
        folder: the folder of the results, with the files of fields.

    Returns:
        The names of the pictures, and why some could not be drawn.

    Raises:
        OutputError: if a result is none of epcontact, or if a file cannot be read or
            written.
    """
    results = {}
    for method, answer in answers.items():
        try:
            results[method] = [*map(ContactResult.from_json, answer["members"])]
        except (ValueError, KeyError, TypeError, AttributeError):
            raise OutputError(
                f"cannot draw {case_id}: {folder / method}.json holds no results of "
                "this version; run verify again"
            ) from None
    return _draw_results(results, folder)


def _draw_results(results: Results, folder: Path) -> Pictures:
    """Draw the pictures that need nothing but the results and the fields in the
    folder, and name all that are there.
    """
    given = {method: each for method, each in results.items() if each}
    charts = charts_of(given)
    for name, chart in charts.items():
        chart.save(folder / name)
    names = [*charts, *_draw_maps(folder, list(given))]
    missing = []
    for method in given:
        if body := _find_body(folder, method):
            name = f"body-{method}"
            if why := _draw_body(body, folder / f"{name}.png", method):
                missing.append(why)
            else:
                names.append(name)
    # Pictures of an earlier run may no longer be those of the results.
    of_methods = (
        f"{kind}-{method}" for kind in ("contact", "body") for method in given
    )
    for name in {*_OF_RESULTS, *of_methods} - {*names}:
        _remove(folder, name)
    of_case = (_SPECTRUM, _MAGNIFICATION, *_film_names(folder))
    names += [name for name in of_case if (folder / f"{name}.txt").is_file()]
    return Pictures(names, missing)


def _remove(folder: Path, name: str) -> None:
    """Remove the files of one picture, which another run has drawn."""
    for ending in _ENDINGS:
        (folder / f"{name}{ending}").unlink(missing_ok=True)


def _film_names(folder: Path) -> list[str]:
    """Return the names of the films of the load paths whose fields are there."""
    return [path.parent.name for path in folder.glob("*-steps/path.pvd")]


def charts_of(found: Results, hardness: float = math.inf) -> dict[str, Chart]:
    """Draw results by method, one a surface, as charts by name, which a notebook
    shows.
    """
    charts: dict[str, Chart] = {}
    if any(result.distribution for each in found.values() for result in each):
        about = next(iter(found.values()))[0].provenance.about
        hardness = (
            float(about["hardness"]["value"]) if "hardness" in about else hardness
        )
        theory = theory_densities(found, hardness)
        chart = pressure_distribution(found, hardness=hardness, theory=theory)
        charts["pressure-distribution"] = chart
    # Only the longest history of each method is drawn; all of them would hide each
    # other.
    longest = {
        m: np.array(max((r.history for r in each), key=len))
        for m, each in found.items()
    }
    if any(np.any(np.isfinite(h) & (h > 0)) for h in longest.values()):
        charts["residuals"] = residual_history(
            {m: h for m, h in longest.items() if h.size}
        )
    paths = {m: load_rows(each) for m, each in found.items() if len(each[0].steps) > 1}
    return charts | (load_charts(paths) if paths else {})


def draw_members(
    folder: Path, loads: Mapping[str, Sequence[Row]], fields: Mapping[Path, str]
) -> None:
    """Draw the contact of every member of a sweep whose fields are kept and, of the
    first points, curves over the load, which joins points of different mean pressures.
    """
    curves: dict[str, list[Row]] = {}
    for name, rows in loads.items():
        parts = [
            part for part in name.split(", ") if not part.startswith("mean_pressure ")
        ]
        curves.setdefault(", ".join(parts), []).extend(rows)
    charts = load_charts(dict(itertools.islice(curves.items(), _MOST_CURVES)))
    for name in LOAD_CHARTS:
        _remove(folder, name)  # it may be of an earlier run
    for name, chart in charts.items():
        chart.save(folder / name)
    for path, words in fields.items():
        if path.is_file():
            caption = f"Contact state and pressure at {words}, {path.name}."
            map_of_file(path, caption).save(folder / f"contact-{path.stem}")


def plot(scene: Scene, *results: ContactResult) -> dict[str, Chart]:
    """Draw what `epcontact run --charts` draws; a notebook shows each chart.

    Args:
        scene, results: a scene and the answers to it; other surfaces' make curves with
            intervals.

    Returns:
        Charts by name: "power-spectrum", "pressure-distribution", "residuals",
        "loads-areas" and others of a path, and a map "contact-METHOD" of each first
        result with fields.  `save` writes one to files.

    Example:
        >>> from epcontact import Load, Material, Surface, bem
        >>> wave = np.cos(2 * np.pi * np.arange(64) / 64)
        >>> scene = Scene(Surface(wave, (50.0,)), Material(1.0, 0.0), Load((0.01, 0.02)))
        >>> list(plot(scene, bem.solve(scene)))
        ['pressure-distribution', 'residuals', 'loads-areas', 'loads-gap', 'contact-bem']
    """
    found: dict[str, list[ContactResult]] = {}
    for result in results:
        found.setdefault(result.method, []).append(result)
    hardness, spectrum = scene.material.hardness, _spectrum_chart(scene.surface)
    charts = {"power-spectrum": spectrum} if spectrum is not None else {}
    charts |= charts_of(found, hardness)
    for method, (first, *_) in found.items():
        if {"state", "pressure", "gap"} <= first.fields.keys():
            caption = f"Contact state and pressure by {method}."
            chart = map_of(first.fields, scene.surface.spacing, hardness, caption)
            charts[f"contact-{method}"] = chart
    return charts


def _draw_maps(folder: Path, methods: Sequence[str]) -> list[str]:
    """Draw the contact of each method's first surface, and the differences on a common
    grid; return the names of the pictures.
    """
    fields = {}
    maps = {}
    for method in methods:
        for path in [
            *folder.glob(f"{method}.vti"),
            *sorted(folder.glob(f"{method}-*.vti")),
        ][:1]:
            fields[method] = read_fields(path)
            caption = f"Contact state and pressure by {method}, {path.name}."
            maps[f"contact-{method}"] = map_of_file(path, caption)
            for step in sorted(path.with_name(f"{path.stem}-steps").glob("*.vti")):
                load = f"mean pressure {read_fields(step).attributes['mean_pressure']:.4g} Pa"
                chart = map_of_file(
                    step, f"Contact state and pressure by {method}, {load}."
                )
                maps[f"contact-{method}-{step.stem}"] = chart
    for names in itertools.combinations(sorted(fields), 2):
        one, two = (fields[name] for name in names)
        if (
            len(one.shape) == 2
            and one.shape == two.shape
            and one.spacing == two.spacing
        ):
            pressures = one.field("pressure"), two.field("pressure")
            chart = pressure_difference(*pressures, one.spacing, names=names)
            maps[f"pressure-difference-{'-'.join(names)}"] = chart
    for name, chart in maps.items():
        chart.save(folder / name)
    return list(maps)


def _find_body(folder: Path, method: str) -> Path | None:
    """Return the collection of a method's finite-element bodies, if it wrote one."""
    collections = [*folder.glob(f"{method}*.pvd"), *folder.glob(f"{method}*/*.pvd")]
    for collection in sorted(collections):
        if load_steps(collection)[0].suffix == ".vtu":
            return collection
    return None


def _draw_body(body: Path, target: Path, method: str) -> str:
    """Draw the body of a method, cut open; return why it could not be drawn, or ""."""
    try:
        screenshot(body, target, size=(1200, 600))
    except OutputError as error:  # many machines cannot draw in three dimensions
        return f"{target.name} is left out: {error}."
    cut = "cut open at the last load: von Mises stress and plastic strain"
    write_text(target.with_suffix(".txt"), f"The body of {method}, {cut}.\n")
    return ""


def theory_densities(results: Results, hardness: float) -> pd.DataFrame | None:
    """The theory's densities by formula, for the chart of all methods' pressures.  If
    the hardness (Pa) is finite, the density without hardness is added, at the same
    diffusion.  None if the theory has no result or the surface has no roughness.
    """
    found = results.get("persson", ())
    diffusion = found[0].final.quantities.get("diffusion", 0.0) if found else 0.0
    if not diffusion > 0:
        return None
    p0 = found[0].final.mean_pressure
    curve = persson.pressure_curve(diffusion, p0, hardness)
    series = {"persson": (curve.pressure, curve.density)}
    if math.isfinite(hardness):
        sigma = np.linspace(0.0, 1.04 * hardness, 300)
        density = persson.pressure_density(sigma, diffusion, p0)
        series["persson without hardness"] = (sigma, density)
    return _tables(series, PRESSURE, DENSITY)


def _tables(series: Mapping[str, tuple[Any, Any]], *columns: str) -> pd.DataFrame:
    """Return pairs of columns below each other, each with the name of its series."""
    return pd.concat(
        pd.DataFrame({"series": name} | dict(zip(columns, pair, strict=True)))
        for name, pair in series.items()
    )


def _spectrum_chart(surface: Surface) -> Chart | None:
    """Figure 2 of the paper: the spectrum of the surface and the one that it was drawn
    from; there is none of a few waves, such as a sinusoid, because a few dots show no
    spectrum.
    """
    spectrum = radial_spectrum(surface)
    shown = spectrum.density > 1e-12 * spectrum.density.max()
    if np.count_nonzero(shown) < _FEWEST_RINGS:
        return None
    analytic, dimension = surface.spectrum, surface.heights.ndim
    series = {"surface": (spectrum.wavenumber[shown], spectrum.density[shown])}
    if analytic is not None:
        waves = np.geomspace(analytic.wavenumber_low, analytic.wavenumber_high, 300)
        series["analytic"] = waves, density(analytic, waves, dimension)
    # The density of a line is the one-dimensional C1 in m^3, that of a surface C in
    # m^4.
    name, power = ("C_1", 3) if dimension == 1 else ("C", 4)
    q, column = "wavenumber_rad_per_m", f"density_m{power}"
    plot = Plot(
        (q, r"wave number $q$ (rad/m)"),
        (column, rf"spectral density ${name}(q)$ (m$^{power}$)"),
        styles={"analytic": "curve"},
        log="xy",
    )
    table = _tables(series, q, column)
    return draw_table(table, plot, "Power spectrum of the surface roughness.")


def _magnification_chart(
    case: Case, areas: persson.MagnificationCurve, results: Results
) -> Chart:
    """Figure 4 of the paper: the theory's areas, and the mean ones of the boundary
    elements.
    """
    steps = [result.final for result in results.get("bem", ())]
    # A user's solver that replaces bem need not have corrected areas.
    corrected = [step.areas["corrected"] for step in steps if "corrected" in step.areas]
    x, y = "magnification", "area_fraction"
    curves, points = [], []
    for part in ("total", "elastic", "plastic"):
        curve = {"part": part, x: areas.magnification, y: getattr(areas, part)}
        curves.append(pd.DataFrame(curve | {"method": "", "style": "curve"}))
        point = {"part": part, x: areas.magnification.max(), "method": "bem"}
        mean = float(np.mean([getattr(found, part) for found in corrected] or [0.0]))
        points.append(pd.DataFrame([point | {y: mean}]))
    table = pd.concat([each for each in (*curves, *points) if (each[y] > 0).any()])
    # Areas vanish exponentially at low magnification and would squeeze everything else,
    # so the axis ends three decades below the largest area.
    known = table[y][table[y] > 0]
    limits = (max(0.7 * known.min(), 1e-3 * known.max()), 1.5 * known.max())
    plot = Plot(
        (x, r"magnification $\zeta = q / q_0$ (–)"),
        (y, r"contact area $A / A_0$ (–)"),
        series=("part", "method"),
        colour="part",
        colours=PART_COLOURS,
        log="xy",
        limits={"ylim": limits},
    )
    gamma = case.options["persson"]["energy_reduction"]
    caption = f"areas against magnification by Persson's theory, gamma = {gamma:g}"
    points_are = "points: the boundary elements, in the continuum limit"
    return draw_table(table, plot, f"{case.id}: {caption}; {points_are}.")
