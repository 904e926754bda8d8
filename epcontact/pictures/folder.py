"""The pictures of results, drawn into the folder of these results.

A folder may come from somebody else.  Files are therefore drawn and deleted by their
exact names, and never by a pattern.
"""

from __future__ import annotations

import io
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from epcontact import persson
from epcontact.errors import OutputError
from epcontact.files import read_bytes, write_bytes, write_json, write_text
from epcontact.harness.case_files.case import Case
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.solving.tasks import peak_path
from epcontact.output.charts.figures import Chart, Pictures
from epcontact.output.charts.maps import compare_pressures, map_of_file
from epcontact.output.charts.style import unit_for
from epcontact.output.loads import Row
from epcontact.output.view import animate, load_steps, screenshot
from epcontact.output.vtk import FieldFile, read_fields
from epcontact.pictures.charts import (
    Results,
    charts_of_results,
    magnification_chart,
    spectrum_chart,
)
from epcontact.pictures.loads import LOAD_CHARTS, load_charts
from epcontact.results import ContactResult

#: A chart of three areas can show so many curves of a sweep.
_MOST_CURVES = 4
#: Charts of the case itself, which only `draw_case` can draw.
_OF_CASE = ("power-spectrum", "persson-magnification")
#: Charts of results whose names do not depend on the methods.
_OF_RESULTS = ("pressure-distribution", "residuals", *LOAD_CHARTS)
#: The files of one picture.
_ENDINGS = (".png", ".svg", ".csv", ".txt", ".webp")
#: The picture of a page has half of the pixels of the .png file along each side: it is
#: about as wide as a column of the page.
_REDUCTION = 2
#: The colours of the picture of a page.  Of Pillow's methods to choose them, the octree
#: keeps the hue of thin lines and grids.  It may leave out a colour of a scale, which
#: would then be drawn white, so that pictures of fields need "maximum coverage".
_COLOURS = 20
#: The colours of a picture with two scales, those of pressures and of differences.
_COLOURS_OF_TWO_SCALES = 120
#: Beginnings of the names of pictures that show fields.
_FIELDS = ("contact-", "pressure-difference-", "body-")


def draw_case(
    case: Case,
    answers: Mapping[str, MethodResults],
    folder: Path,
    vector: bool = False,
) -> Pictures:
    """Draw the pictures of a case that was solved.

    Args:
        case: the case.
        answers: the results of its methods, by the methods' names.
        folder: the folder of its results, with the files of fields.
        vector: whether to write each chart as an .svg file, too.

    Returns:
        The names of the pictures, and why some could not be drawn.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    scene = case.scene(case.recipes[0])
    results = {
        method: answer.results for method, answer in answers.items() if answer.results
    }
    spectrum = spectrum_chart(scene.surface)
    if spectrum is not None:
        _save(spectrum, folder / "power-spectrum", vector)
    if "persson" in results:
        options = case.options["persson"]
        theory = persson.Theory.of_scene(scene, **options)
        areas = theory.magnification_curve(scene.load.final)
        pressures = theory.pressure_curve(scene.load.final)
        gamma = options["energy_reduction"]
        chart = magnification_chart(case.id, areas, results.get("bem", ()), gamma)
        _save(chart, folder / "persson-magnification", vector)
        _write_columns(folder / "persson-magnification.json", areas.columns())
        _write_columns(folder / "persson-pressure.json", pressures.columns())
    return _draw_results(results, folder, vector)


def _save(chart: Chart, stem: Path, vector: bool) -> None:
    """Write a chart to files, and delete an .svg file of an earlier run.

    Args:
        chart: the chart.
        stem: the path of the files without an ending.
        vector: whether to write an .svg file.

    Raises:
        OutputError: if a file cannot be written.
    """
    chart.save(stem, vector)
    if not vector:
        Path(f"{stem}.svg").unlink(missing_ok=True)


def write_page_pictures(folder: Path, names: Sequence[str]) -> None:
    """Write a small copy (.webp) of each picture (.png), for a page.

    A picture without a .png file, such as a film, has none.

    Args:
        folder: the folder of the pictures.
        names: their names without endings.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    for name in names:
        source = folder / f"{name}.png"
        if source.is_file():
            small = Image.open(io.BytesIO(read_bytes(source))).convert("RGB")
            method = Image.Quantize.FASTOCTREE
            colours = _COLOURS
            if name.startswith(_FIELDS):
                method = Image.Quantize.MAXCOVERAGE
            if name.startswith("pressure-difference-"):
                colours = _COLOURS_OF_TWO_SCALES
            small = small.reduce(_REDUCTION).quantize(
                colours, method, dither=Image.Dither.NONE
            )
            content = io.BytesIO()
            small.convert("RGB").save(content, "webp", lossless=True)
            write_bytes(folder / f"{name}.webp", content.getvalue())


def _write_columns(path: Path, columns: Mapping[str, Any]) -> None:
    """Write the columns of a table to a JSON file.

    Args:
        path: the file to write.
        columns: sequences of numbers, by name.

    Raises:
        OutputError: if the file cannot be written.
    """
    write_json(path, {name: list(values) for name, values in columns.items()})


def draw_saved(case_id: str, files: Sequence[Path]) -> Pictures:
    """Draw the pictures of results that are in files.

    Args:
        case_id: the id of the case, for messages.
        files: the JSON file of each method, named after the method.  They are in one
            folder, which also has the files of fields and gets the pictures.

    Returns:
        The names of the pictures, and why some could not be drawn.

    Raises:
        OutputError: if a result is none of epcontact, or if a file cannot be read or
            written.
    """
    results = {}
    for file in files:
        try:
            members = json.loads(read_bytes(file))["members"]
            results[file.stem] = [*map(ContactResult.from_json, members)]
        except (ValueError, KeyError, TypeError, AttributeError):
            raise OutputError(
                f"cannot draw {case_id}: {file} holds no results of this version; run "
                "verify again"
            ) from None
    return _draw_results(results, files[0].parent, vector=False)


def _draw_results(results: Results, folder: Path, vector: bool) -> Pictures:
    """Draw the pictures that need nothing but results and their fields.

    Pictures that an earlier run has drawn of other results are deleted.

    Args:
        results: the results of each method, by its name: one for each surface.
        folder: the folder of the results, with the files of fields.
        vector: whether to write each chart as an .svg file, too.

    Returns:
        The names of the pictures, and a sentence for each body that could not be drawn.
        The names include the charts of the case and the films that the folder has.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    results = {method: each for method, each in results.items() if each}
    charts = charts_of_results(results)
    charts |= _maps(folder, [*results])
    for name, chart in charts.items():
        _save(chart, folder / name, vector)
    names = [*charts]
    missing = []
    for method in results:
        body = _find_body(folder, method)
        if body is None:
            continue
        try:
            names.append(_draw_body(body, method, folder))
        except OutputError as error:  # many machines cannot draw in three dimensions
            missing.append(f"body-{method}.png is left out: {error}.")
    kinds = ("contact-{}", "contact-{}-peak", "body-{}")
    of_methods = [kind.format(name) for kind in kinds for name in results]
    _remove({*_OF_RESULTS, *of_methods} - {*names}, folder)
    for name in (*_OF_CASE, *_film_names(folder)):
        if (folder / f"{name}.txt").is_file():
            names.append(name)
    return Pictures(names, missing)


def _remove(names: set[str], folder: Path) -> None:
    """Delete pictures, whichever of their files exist.

    Args:
        names: the names of the pictures without endings.
        folder: the folder of the pictures.
    """
    for name in names:
        for ending in _ENDINGS:
            (folder / f"{name}{ending}").unlink(missing_ok=True)


def draw_sweep(
    folder: Path, loads: Mapping[str, Sequence[Row]], fields: Mapping[Path, str]
) -> None:
    """Draw the pictures of a sweep: curves over the load, and maps of the contact.

    Args:
        folder: the folder of the sweep.
        loads: the rows of each point and method, by words such as "hardness 1e+09,
            bem".  Points that differ only in their mean pressure become one curve.
            Only the first curves are drawn.
        fields: the files of fields, and in words the point and method of each.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    curves: dict[str, list[Row]] = {}
    for point, rows in loads.items():
        words = [w for w in point.split(", ") if not w.startswith("mean_pressure ")]
        curves.setdefault(", ".join(words), []).extend(rows)
    charts = load_charts(dict(itertools.islice(curves.items(), _MOST_CURVES)))
    for name, chart in charts.items():
        chart.save(folder / name)
    _remove({*LOAD_CHARTS} - charts.keys(), folder)
    for path, point in fields.items():
        if path.is_file():
            caption = f"Contact state and pressure at {point}, {path.name}."
            map_of_file(path, caption).save(folder / f"contact-{path.stem}")


def draw_films(folder: Path) -> Pictures:
    """Draw a film of every load path whose fields are in a folder.

    The fields of a path are in a subfolder such as "bem-steps".  The film, a .gif, and
    its caption are written into the folder itself.  A path of one load has no film.

    Returns:
        The names of the films (.gif), and why some could not be drawn.

    Raises:
        OutputError: if a file cannot be read or written.
    """
    names = []
    missing = []
    for name in _film_names(folder):
        collection = folder / name / "path.pvd"
        if len(load_steps(collection)) == 1:
            continue
        film = folder / f"{name}.gif"
        try:
            animate([collection], film)
        except OutputError as error:  # many machines cannot draw; the results are there
            missing.append(f"{film} is left out: {error}")
        else:
            write_text(folder / f"{name}.txt", f"The loads of the path {name}.\n")
            names.append(name)
    return Pictures(names, missing)


def _film_names(folder: Path) -> list[str]:
    """Return the names of the load paths whose fields are in a folder, sorted.

    A name is that of a subfolder such as "bem-steps" with a collection "path.pvd".
    """
    return sorted(path.parent.name for path in folder.glob("*-steps/path.pvd"))


def _maps(folder: Path, methods: Sequence[str]) -> dict[str, Chart]:
    """Return maps of the contact, and differences of pressures between methods.

    Args:
        folder: the folder of the results, with the files of fields.
        methods: the names of the methods; of each, the first surface is drawn.

    Returns:
        The charts by name: "contact-METHOD", one "contact-METHOD-STEP" for each load
        with fields, and "pressure-difference-A-B" for methods on one grid.

    Raises:
        OutputError: if a file cannot be read or lacks a field.
    """
    charts: dict[str, Chart] = {}
    files: dict[str, FieldFile] = {}
    for method in methods:
        path = _first_fields(folder, method)
        if path is None:
            continue
        files[method] = read_fields(path)
        caption = f"Contact state and pressure by {method}, {path.name}."
        peak = peak_path(path)
        if peak.is_file():
            caption = _caption_at_load(method, "last", path)
            peak_caption = _caption_at_load(method, "largest", peak)
            charts[f"contact-{method}-peak"] = map_of_file(peak, peak_caption)
        charts[f"contact-{method}"] = map_of_file(path, caption)
        for step in sorted(path.with_name(f"{path.stem}-steps").glob("*.vti")):
            caption = _caption_at_load(method, "a", step)
            charts[f"contact-{method}-{step.stem}"] = map_of_file(step, caption)
    for names in itertools.combinations(sorted(files, reverse=True), 2):
        first, second = (files[name] for name in names)
        common = (first.shape, first.spacing) == (second.shape, second.spacing)
        if common and len(first.shape) == 2:
            name = f"pressure-difference-{'-'.join(names)}"
            charts[name] = compare_pressures(first, second)
    return charts


def _caption_at_load(method: str, which: str, path: Path) -> str:
    """Return the caption of the contact map of one load of a path.

    Args:
        method: the name of the method.
        which: "last", "largest", or "a" for any other load.
        path: the .vti file, which states its mean pressure (Pa).

    Raises:
        OutputError: if the file cannot be read.
    """
    mean_pressure = read_fields(path).attributes.get("mean_pressure")
    if not isinstance(mean_pressure, float):
        mean_pressure = math.nan
    scale, unit = unit_for(mean_pressure, "Pa")
    load = "a load" if which == "a" else f"the {which} load of the path"
    return (
        f"Contact by {method} at {load}, {mean_pressure / scale:.4g} {unit}: state, "
        f"and pressure or what flow has left ({path.name})."
    )


def _first_fields(folder: Path, method: str) -> Path | None:
    """Return the path of the fields (.vti) of a method's only or first surface.

    The path is None if the folder has no fields of the method.
    """
    paths = [folder / f"{method}.vti", *sorted(folder.glob(f"{method}-*.vti"))]
    peaks = {peak_path(path) for path in paths}
    return next((p for p in paths if p.is_file() and p not in peaks), None)


def _find_body(folder: Path, method: str) -> Path | None:
    """Return the path of the collection (.pvd) of a method's finite-element bodies.

    The path is None if the folder has none.  Raises OutputError if a collection of the
    method cannot be read.
    """
    collections = [*folder.glob(f"{method}*.pvd"), *folder.glob(f"{method}*/*.pvd")]
    for collection in sorted(collections):
        if load_steps(collection)[0].suffix == ".vtu":
            return collection
    return None


def _draw_body(body: Path, method: str, folder: Path) -> str:
    """Draw a finite-element body at its last load, cut open, and write the caption.

    Args:
        body: the collection (.pvd) of the body's load steps.
        method: the name of the method.
        folder: the folder of the picture.

    Returns:
        The name of the picture without its ending, "body-METHOD".

    Raises:
        OutputError: if the body cannot be read or drawn, or a file not written.
    """
    name = f"body-{method}"
    screenshot(body, folder / f"{name}.png", size=(1200, 600))
    view = "cut open at the last load: von Mises stress and plastic strain"
    write_text(folder / f"{name}.txt", f"The body of {method}, {view}.\n")
    return name
