"""The pictures of a report: drawn from a case's answers and from the files in its folder."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.errors import OutputError
from epcontact.output.report.page import Picture
from epcontact.results import PressureDistribution, number_from_json

Data = Mapping[str, Any]


def charts_of(answers: Mapping[str, Data]) -> list[Picture]:
    """P(sigma) of all methods on one axis, and the solvers' residuals."""
    return [
        Picture(chart.svg(), "svg", chart.caption)
        for chart in (_distribution_chart(answers), _history_chart(answers))
        if chart is not None
    ]


def _distribution_chart(answers: Mapping[str, Data]) -> Any:
    from epcontact.output.charts.curves import pressure_density, pressure_distribution
    from epcontact.output.charts.figures import Series

    series, plastic, hardness, loads = [], {}, np.inf, []
    for method, data in answers.items():
        tables = [
            _distribution(m["distribution"]) for m in data.get("members", []) if m["distribution"]
        ]
        if not tables:
            continue
        loads.append(number_from_json(data["mean_pressure"]))
        share = float(np.mean([t.plastic for t in tables]))
        if share > 0:
            plastic[method] = share
            hardness = float(max(t.pressure[-1] for t in tables))
        theory = method == "persson"
        top = max(float(t.pressure[-1]) for t in tables)
        found = [pressure_density(t, 256 if theory else 50, top) for t in tables]
        mean = np.mean([density for _, density in found], axis=0)
        series.append(Series(method, found[0][0], mean, line=theory))
    if not series:
        return None
    elastic = _elastic_theory(answers.get("persson"), hardness)
    told = (
        "Probability density of the contact pressure per nominal area, mean of all surfaces. "
        "The theory is equation (3) where there is a hardness, equation (1) where there is none"
        + ("; (1) is also drawn for comparison. " if elastic else ". ")
        + "The areas apart and at the hardness are delta functions, which are not drawn."
    )
    return pressure_distribution(
        [*series, *elastic],
        mean_pressure=loads[0],
        hardness=hardness,
        plastic=plastic,
        caption=told,
    )


def _elastic_theory(answer: Data | None, hardness: float) -> list[Any]:
    """Equation (1) beside (3), at the same G, where the theory tells its G."""
    from epcontact.output.charts.figures import Series

    quantities = (answer or {}).get("members", [{}])[0].get("quantities", {})
    if answer is None or "diffusion" not in quantities or not np.isfinite(hardness):
        return []
    G, p0 = number_from_json(quantities["diffusion"]), number_from_json(answer["mean_pressure"])
    sigma = np.linspace(0.0, 1.04 * hardness, 300)
    density = (np.exp(-((sigma - p0) ** 2) / (4 * G)) - np.exp(-((sigma + p0) ** 2) / (4 * G))) / (
        np.sqrt(4 * np.pi * G)
    )
    return [Series("elastic, equation (1)", sigma, density, line=True)]


def _distribution(data: Data) -> PressureDistribution:
    pressure, cumulative = (
        np.array([number_from_json(v) for v in data[k]]) for k in ("pressure", "cumulative")
    )
    return PressureDistribution(pressure, cumulative, number_from_json(data["plastic"]))


def _history_chart(answers: Mapping[str, Data]) -> Any:
    from epcontact.output.charts.curves import history
    from epcontact.output.charts.figures import Series

    series = []
    for method, data in answers.items():
        told = [m["history"] for m in data.get("members", []) if m.get("history")]
        if told:
            # The surface that took longest; the others would hide each other.
            longest = [number_from_json(value) for value in max(told, key=len)]
            series.append(Series(method, np.arange(len(longest)), longest))
    if not any(np.any(np.isfinite(s.y) & (s.y > 0)) for s in series):
        return None
    told_caption = "Residual of the iteration on the finest grid, of the surface that took longest."
    return history(series, caption=told_caption)


def pictures_in(folder: Path, answers: Mapping[str, Data], notes: list[str]) -> list[Picture]:
    """What can be shown of the files in a case's folder; `notes` gets what could not, and why."""
    pictures = []
    for chart in sorted(folder.glob("*.svg")):
        caption = chart.with_suffix(".txt")
        # The distributions are drawn anew, of all methods.
        if chart.stem != "pressure-distribution" and caption.is_file():
            pictures.append(Picture(chart.read_bytes(), "svg", caption.read_text("utf-8").strip()))
    fields = {method: found for method in answers if (found := _first_fields(folder, method))}
    pictures += [_map_of(path, method) for method, path in fields.items()]
    if {"bem", "fem"} <= fields.keys():
        pictures += _difference_of(fields["bem"], fields["fem"])
    for method in answers:
        collections = [*folder.glob(f"{method}*.pvd"), *folder.glob(f"{method}*/*.pvd")]
        for collection in sorted(collections)[:1]:
            pictures += _block_of(collection, method, notes)
    return pictures


def _first_fields(folder: Path, method: str) -> Path | None:
    found = [folder / f"{method}.vti", *sorted(folder.glob(f"{method}-*.vti"))]
    return next((path for path in found if path.is_file()), None)


def _map_of(path: Path, method: str) -> Picture:
    from epcontact.output.charts.maps import map_of_file

    told = f"Contact state and pressure by {method}, {path.name}."
    return Picture(map_of_file(path, told).png(110), "png", told)


def _difference_of(bem: Path, fem: Path) -> list[Picture]:
    """Where both lie on one surface grid."""
    from epcontact.output.charts.maps import pressure_difference
    from epcontact.output.vtk import read_fields

    one, two = read_fields(bem), read_fields(fem)
    if len(one.shape) != 2 or one.shape != two.shape or one.spacing != two.spacing:
        return []
    told = "Contact pressure by boundary elements and by finite elements, and their difference."
    first, second = (read.fields["pressure"] for read in (one, two))
    chart = pressure_difference(first, second, one.spacing, caption=told)
    return [Picture(chart.png(110), "png", told)]


def _block_of(path: Path, method: str, notes: list[str]) -> list[Picture]:
    from epcontact.output.view.view import screenshot

    told = f"The body of {method}, cut open at the last load: von Mises stress, plastic strain."
    with tempfile.TemporaryDirectory() as folder:
        try:
            screenshot(path, Path(folder) / "x.png", size=(1200, 600))
        except OutputError as error:
            notes.append(f"Left out of this page: {error}.")
            return []
        return [Picture((Path(folder) / "x.png").read_bytes(), "png", told)]
