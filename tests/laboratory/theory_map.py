"""The laboratory of the theory's error: it makes the map `persson/theory_map.csv`.

The scenes are the sweeps of `cases/theory-map.toml`: boundary elements and the theory at places of
the plane of p0/hardness (without a hardness: of p0/(E* xi)) and hardness/(E* xi), for several
spectra.  An error is the theory's figure over the mean of the boundary elements' less one; areas
are corrected, and the pressures lose at each end the share that the correction takes from it.

`python -m laboratory.theory_map --size large` makes the map of the package in some half an hour of
one core (`fast`: a small one that shows how), and solves no scene again that `--output` holds.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import pandas as pd

from epcontact.errors import EpcontactError
from epcontact.files import whole_file
from epcontact.harness.answers.store import kept
from epcontact.harness.case_files.text import case_name, package_files, read_cases
from epcontact.harness.gates import distance
from epcontact.harness.sweep import read_sweep, run_sweep
from epcontact.materials.moduli import effective_modulus
from epcontact.results import PressureDistribution, package_versions

PLACE = ["hurst", "wavelength_ratio", "roll_off", "hardness", "load"]
PARTS = ("total", "elastic", "plastic")
#: Slopes are means within this share of the smaller of hardness and E* xi, below a hardness of
#: which (over E* xi) the points next to a rim fill the window on four points a wave.
WINDOW, LEAST = 0.2, 0.6
HEADER = """\
# The theory's error; tests/laboratory/theory_map.py says what the columns are.
# Made by `python -m laboratory.theory_map --size {size}` with {versions}.
"""


def make_map(size, output, jobs=None):
    """Solve the scenes of the map that are not kept in `output`; return the map and its file.

    Raises EpcontactError if a scene has no result; the scenes that have one are kept.
    """
    rows = []
    (file,) = (file for file in package_files() if case_name(file) == "theory-map")
    for case in read_cases(file):
        if size not in case.sizes:
            continue
        swept = run_sweep(case, size=size, output=output, jobs=jobs)
        if swept.failures:
            raise EpcontactError(f"{case.id}: scenes have no result, {swept.failures}")
        places = {}
        for task, point in zip(*read_sweep(case, size)[:2], strict=True):
            places.setdefault(str(point), []).append(task)
        print(f"{case.id}: {swept.reused} results reused; the errors of {len(places)} places")
        rows += [place_row(tasks, output) for tasks in places.values()]
    made = pd.DataFrame(rows)
    path = output / "theory-map" / size / "theory_map.csv"
    versions = ", ".join(f"{name} {version}" for name, version in package_versions().items())
    with whole_file(path) as temporary:
        text = HEADER.format(size=size, versions=versions) + made.to_csv(
            index=False, float_format="%.4g"
        )
        temporary.write_text(text, encoding="utf-8")
    return made, path


def place_row(tasks, output):
    """The errors of the theory at one place, with their standard errors and the grid's claims."""
    (theory,) = (kept(task, output) for task in tasks if task.method.name == "persson")
    found = [kept(task, output) for task in tasks if task.method.name == "bem"]
    case, spectrum = tasks[0].case, tasks[0].recipe.spectrum
    unit, hardness = effective_modulus(case.material) * spectrum.rms_slope, case.material.hardness
    scale = hardness if math.isfinite(hardness) else unit
    row = {
        "hurst": spectrum.hurst,
        "wavelength_ratio": spectrum.wavenumber_high / spectrum.wavenumber_low,
        "roll_off": spectrum.wavenumber_roll_off / spectrum.wavenumber_low,
        "hardness": hardness / unit,
        "load": theory.final.mean_pressure / scale,
        "surfaces": len(found),
    }
    for part in PARTS:
        exact = getattr(theory.final.areas["raw"], part)
        values = [getattr(result.final.areas["corrected"], part) for result in found]
        claim = np.mean([getattr(result.final.areas["error"], part) for result in found])
        known = np.mean(values) > claim  # else the grid does not resolve it
        row |= errors(part, exact, values if known else [math.nan])
        row[f"{part}_grid"] = (1 + row[part]) * claim / np.mean(values) if known else math.nan
    gap = "mean_gap"
    gaps = [result.final.quantities[gap] for result in found]
    row |= errors(gap, theory.final.quantities[gap], gaps)
    pressures = [corrected(result) for result in found]
    row |= distances(pressures, theory.distribution, hardness)
    width = WINDOW * min(hardness, unit)
    exact = end_shares(theory.distribution, width)
    measured = np.transpose([end_shares(one, width) for one in pressures])
    for end, share, values in zip(("zero", "hardness"), exact, measured, strict=True):
        known = hardness >= LEAST * unit * 0.99 and np.mean(values) > 1e-5
        row |= errors(f"slope_at_{end}", share, values if known else [math.nan])
    return row


def errors(name, exact, values):
    """The relative error of the theory's figure, with its standard error by the surfaces."""
    mean = np.mean(values)
    deviation = np.std(values, ddof=1) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    error = exact / mean - 1 if mean else math.nan
    return {name: error, f"{name}_error": (1 + error) * deviation / mean}


def corrected(result):
    """The distribution of the pressures without what the correction takes from its ends."""
    raw, areas, known = (
        *(result.final.areas[k] for k in ("raw", "corrected")),
        result.distribution,
    )
    share = np.clip(known.cumulative - (raw.total - areas.total), 0, areas.elastic)
    return PressureDistribution(known.pressure, share, areas.plastic)


def distances(pressures, exact, hardness):
    """The Wasserstein distance of the mean distribution from the theory's, and its error."""
    sigma = np.unique(np.concatenate([one.pressure for one in pressures]))
    shares = np.array([np.interp(sigma, one.pressure, one.cumulative) for one in pressures])
    plastic = np.array([one.plastic for one in pressures])

    def off(used):
        mean = PressureDistribution(sigma, shares[used].mean(0), plastic[used].mean())
        return distance("wasserstein", exact, mean, hardness)

    n = len(pressures)
    without = [off(np.arange(n) != left) for left in range(n)] if n > 1 else [math.nan]
    error = math.sqrt((n - 1) * np.var(without))
    return {"wasserstein": off(np.arange(n)), "wasserstein_error": error}


def end_shares(known, width):
    """The shares of the area within a width of pressure of zero, and of the upper end."""
    top = known.pressure[-1] - width
    low, high = np.interp([width, top], known.pressure, known.cumulative)
    return low, known.cumulative[-1] - high


def main():
    """Make the map of a size."""
    parser = argparse.ArgumentParser(prog="python -m laboratory.theory_map")
    parser.add_argument("--size", choices=["fast", "large"], default="fast")
    parser.add_argument("--output", type=Path, default=Path("results"))
    parser.add_argument("--jobs", type=int)
    given = parser.parse_args()
    made, path = make_map(given.size, given.output, given.jobs)
    print(f"{len(made)} places in {path}")


if __name__ == "__main__":
    main()
