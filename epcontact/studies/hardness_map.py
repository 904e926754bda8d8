"""The map of the effective hardness: the paths of its case file, the caps, the file and a chart.

One load path of a J2 body passes every load of the map, and boundary elements capped at a ladder
of hardnesses answer each of these loads on the same elements' compliance.  The paths are sweeps of
the cases in `cases/hardness-map.toml`; `hardness_fit` makes the map from the areas.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from epcontact.errors import EpcontactError
from epcontact.harness.answers.store import Task, kept
from epcontact.harness.case_files.text import case_name, package_files, read_cases
from epcontact.harness.quantities.model_difference import capped_body, elements_compliance
from epcontact.harness.sweep import Swept, read_sweep
from epcontact.materials.hardness_map import (
    FULL,
    SYMBOLS,
    fitted_ratio,
    formula_text,
    hardness_map,
)
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.study import Plot, draw_table
from epcontact.output.files import whole_file
from epcontact.results import ContactResult, package_versions
from epcontact.scene import Load
from epcontact.studies.hardness import TABOR
from epcontact.studies.hardness_fit import mapped
from epcontact.studies.tables import Progress, Size

#: The file of cases that came with the package, whatever the folder ./cases holds.
CASES = "hardness-map"
#: Caps over the yield stress that are tried, besides none.
LADDER = tuple(1.08**k for k in range(21))


def make_map(
    size: str, output: Path, solve: Callable[..., Swept], progress: Progress
) -> tuple[pd.DataFrame, Path]:
    """Solve the load paths of the map, as far as they are not kept, and make the map.

    Args:
        size: of the cases: "large" for the map, "fast" for a small one that shows how it is made.
        output: folder of the results; the map is written to `<output>/hardness-map/<size>`.
        solve: `run_sweep`, or a partial of it with options on where to solve.
        progress: called with a sentence before the areas of a sweep are measured.

    Returns:
        The map (the columns of `materials/hardness_map.csv`) and its file.

    Raises:
        EpcontactError: if a path has no result; the paths that have one are kept.
        OutputError: if a file cannot be written.
    """
    areas = []
    (file,) = (file for file in package_files() if case_name(file) == CASES)
    for case in read_cases(file):
        if size not in case.sizes:
            continue
        swept = solve(case, size=size, output=output)
        if swept.failures:
            name, reason = next(iter(swept.failures.items()))
            raise EpcontactError(
                f"{case.id}: {len(swept.failures)} paths have no result, such as {name} ({reason})"
            )
        tasks = read_sweep(case, size).tasks
        progress(f"{case.id}: the caps of equal area of {len(tasks)} load paths")
        found = [measured_areas(task, answer) for task in tasks if (answer := kept(task, output))]
        areas.append(pd.concat(found, ignore_index=True))
    made = mapped(pd.concat(areas))
    path = output / CASES / size / "hardness_map.csv"
    versions = ", ".join(f"{name} {version}" for name, version in package_versions().items())
    lines = (
        "The effective hardness of rough J2 metals; help(epcontact.effective_hardness) says more.",
        f"Made by `epcontact hardness-map --size {size}` with {versions}.",
        "Errors are relative, at 95 %: scatter by the surfaces of a place alone, the statistical",
        "one of the formula, which pools all places.",
    )
    with whole_file(path) as temporary:
        text = "".join(f"# {line}\n" for line in lines) + made.round(6).to_csv(index=False)
        temporary.write_text(text, encoding="utf-8")
    return made, path


def measured_areas(task: Task, j2: ContactResult) -> pd.DataFrame:
    """Measure the raw areas of a J2 body and of capped bodies on the same compliance.

    Args:
        task: a load path of a self-affine surface over a bonded layer, by the finite elements.
        j2: its answer.

    Returns:
        One row for each load and cap: the columns of `hardness_fit.inverse_hardness`.
    """
    scene = task.case.scene(task.recipe)
    material, surface = scene.material, scene.surface
    spectrum, sigma_Y = surface.spectrum, material.yield_stress
    assert spectrum is not None
    compliance = elements_compliance(scene, j2)
    columns = {
        "nodes": surface.shape[0],
        "waves": round(spectrum.wavenumber_high * surface.periods[0] / (2 * math.pi)),
        "hurst": spectrum.hurst,
        "depth": _short(scene.body.depth / surface.periods[0]),
        "step_tolerance": j2.provenance.options["step_tolerance"],
        "severity": _short(effective_modulus(material) * spectrum.rms_slope / sigma_Y),
        "poisson_ratio": material.poisson_ratio,
        "seed": surface.seed,
    }
    tables = []
    for step in j2.steps:
        load, area = _short(step.mean_pressure / sigma_Y), step.areas["raw"].total
        caps = _caps_around(load, area)
        single = replace(scene, load=Load(step.mean_pressure))
        capped = [capped_body(single, cap * sigma_Y, compliance).final for cap in caps]
        areas = [answer.areas["raw"].total for answer in capped]
        row = columns | {"load": load, "j2_area": area, "cap": caps, "cap_area": areas}
        tables.append(pd.DataFrame(row))
    return pd.concat(tables, ignore_index=True)


def _short(value: float) -> float:
    """A value as the case gives it, without the rounding of a quotient."""
    return float(f"{value:.9g}")


def _caps_around(load: float, area: float) -> list[float]:
    """The caps of LADDER that may carry the load on the area, and none; all over sigma_Y.

    No capped body presses with more than its cap, so that the cap is at least load/area.
    """
    low, high = max(load, 0.9 * load / area), 2.4 * load / area
    return [*(cap for cap in LADDER if low < cap <= high), math.inf]


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Draw the kept map, one chart for each Poisson's ratio."""
    del size, progress
    known = pd.DataFrame(dict(hardness_map()))
    return tuple(draw_map(part) for _, part in known.groupby("poisson_ratio"))


def draw_map(known: pd.DataFrame) -> Chart:
    """Draw the map at one Poisson's ratio, with the formula."""
    nu = float(known["poisson_ratio"].iloc[0])
    known = known[(known["area"] <= FULL) & (known["inverse_hardness"] > 0)]
    parts = ("scatter", "grid_error", "steps_error", "depth_error")
    error = np.sqrt(sum(known[part] ** 2 for part in parts))
    inverse, name = (
        known["inverse_hardness"],
        known["severity"].map("E* xi / sigma_Y = {:g}".format),
    )
    columns = {
        "colour": known["severity"],
        "load": known["load"],
        "effective_hardness": 1 / inverse,
    }
    bounds = {
        "effective_hardness_low": 1 / (inverse * (1 + error)),
        "effective_hardness_high": 1 / (inverse * np.maximum(1 - error, 0.5)),
    }
    fit = fitted_ratio(*(known[axis].to_numpy() for axis in SYMBOLS))
    tables = [
        pd.DataFrame(columns | bounds | {"series": name, "style": "marks"}),
        pd.DataFrame(
            columns
            | {
                "effective_hardness": fit,
                "series": name.str.replace("E* xi / sigma_Y = ", "") + ", formula",
                "style": "curve",
            }
        ),
    ]
    return draw_table(
        pd.concat(tables),
        Plot(
            ("load", "p0 / sigma_Y (–)"),
            ("effective_hardness", "effective hardness c = hardness / sigma_Y (–)"),
            colour="colour",
            log="x",
            ticks=sorted(known["load"].unique()),
            level=TABOR,
        ),
        f"The effective hardness of rough J2 metals of Poisson's ratio {nu:g}: the cap, in yield "
        "stresses, under which capped boundary elements carry the load on the J2 body's area. "
        "Bars: 95 % intervals for the spectrum of the map; other spectra change it by "
        f"{100 * known['spectrum_error'].iloc[0]:.0f} % (95 %). "
        f"Curves: {formula_text()}. Dotted: 3, Tabor's rule. Places of a contact area above "
        f"{FULL:g} are left out.",
    )
