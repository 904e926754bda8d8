"""The benchmark's heights, and its results by every code that is installed.

    python -m laboratory.benchmark heights
    python -m laboratory.benchmark sources
    python -m laboratory.benchmark CODE ... [SCENE ...]

The first writes the heights to cases/benchmark/SCENE.csv anew, and a table of the
scenes.  The second writes sources.csv.  The third solves the named scenes, or all, by
the named codes, keys of CODES, and writes their results into results.csv and
pressures.csv beside the heights.  CalculiX takes half an hour of a core, each of the
others at most minutes.
"""

import itertools
import math
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from epcontact.crosscheck.report import error_budget
from epcontact.errors import EpcontactError, InvalidScene
from epcontact.harness.case_files.case import find_named, load_case
from epcontact.harness.gates import difference
from epcontact.harness.methods.registry import METHODS
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.roughness import rms_slope
from epcontact.scene import Load, SelfAffineSpectrum, Surface
from epcontact.surfaces import Paraboloid, SelfAffine
from fem_check.driver import FemOptions, problem_of

FOLDER = Path(__file__).parents[2] / "cases" / "benchmark"
#: Period of the scenes along y, in m; all but one have it along x, too.
PERIOD = 1e-3


# --- the heights


def rough(seed, hurst, waves, slope, points=21, period=PERIOD):
    """Return a self-affine surface of 1 to `waves` waves in PERIOD.

    Args:
        seed: its seed.
        hurst: Hurst exponent.
        waves: number of the shortest waves in PERIOD.
        slope: rms slope.
        points: number of points along x.
        period: along x, in m.
    """
    wave = 2 * math.pi / PERIOD
    spectrum = SelfAffineSpectrum(hurst, wave, wave, waves * wave, slope)
    return SelfAffine(spectrum, (period, PERIOD), (points, 21), seed=seed).build()


def worn(surface):
    """Return a surface with its summits flattened and its valleys left, as by wear.

    The skewness of the heights is then negative, and shorter waves than before occur.
    """
    heights = surface.heights / surface.heights.std()
    flattened = -np.log1p(np.exp(-1.5 * heights)) * surface.heights.std()
    return Surface(flattened, surface.periods)


def surfaces():
    """Return the six surfaces by the names of their scenes."""
    return {
        "mild": rough(9001, 0.5, 3, 0.02),
        "severe": rough(9002, 0.3, 2, 0.04),
        "oblong": rough(9003, 0.7, 2.5, 0.03, points=31, period=1.5 * PERIOD),
        "layer": rough(9004, 0.9, 3, 0.025),
        "unloading": worn(rough(9005, 0.6, 3, 0.02)),
        "sphere": Paraboloid((PERIOD, PERIOD), (21, 21), radius=1e-2).build(),
    }


def write_heights():
    """Write a file of x, y and height (m) of each point for each scene."""
    FOLDER.mkdir(exist_ok=True)
    for name, surface in surfaces().items():
        heights = surface.heights - surface.heights.mean()
        axes = [
            period / n * np.arange(n)
            for n, period in zip(heights.shape, surface.periods, strict=True)
        ]
        x, y = np.meshgrid(*axes, indexing="ij")
        columns = {"x [m]": x, "y [m]": y, "height [m]": heights}
        table = pd.DataFrame({key: values.ravel() for key, values in columns.items()})
        table.to_csv(FOLDER / f"{name}.csv", index=False, float_format="%.8g")


def write_scenes():
    """Write the table of the scenes: body, material, loads, and the block of elements.

    Lengths are in m and stresses in Pa.
    """
    rows = []
    for name, case in cases().items():
        scene = case.scene(case.recipes[0])
        material = scene.material
        slope = rms_slope(scene)
        block = problem_of(scene, FemOptions(**case.options["fem"])).block
        rows.append(
            {
                "scene": name,
                "body": scene.body.kind,
                "period_x": scene.surface.periods[0],
                "period_y": scene.surface.periods[1],
                "points_x": scene.surface.shape[0],
                "points_y": scene.surface.shape[1],
                "young_modulus": material.young_modulus,
                "poisson_ratio": material.poisson_ratio,
                "yield_stress": material.yield_stress,
                "mean_pressures": " ".join(f"{load:g}" for load in scene.load.path),
                "rms_slope": slope,
                "severity": effective_modulus(material) * slope / material.yield_stress,
                "block_depth": block.depth,
                "block_layers": " ".join(f"{layer:.6g}" for layer in block.layers),
            }
        )
    table = pd.DataFrame(rows)
    table.to_csv(FOLDER / "scenes.csv", index=False, float_format="%.6g")


# --- the results

#: The codes by the names of their columns, each with the name of its method and, where
#: pressures have a largest one, what this hardness is.
CODES = {
    "plain": ("plain", ""),
    "fem": ("fem", ""),
    "calculix": ("calculix", ""),
    "tamaas": ("tamaas_j2", ""),
    "bem-effective": ("bem", "effective"),
    "bem-3": ("bem", "3"),
    "theory-effective": ("persson", "effective"),
    "theory-3": ("persson", "3"),
}
THEORY = {"energy_reduction": 0.536, "spectrum": "surface"}
#: Columns that name a row of results, and a value of the pressures.
ROW = ["scene", "load", "code"]
POINT = ["scene", "load", "i", "j"]
#: A code runs again until this many seconds have passed; its shortest time counts.
TIMED = 2.0


def cases():
    """Return the cases of the benchmark by the names of their scenes."""
    found = map(load_case, find_named("benchmark"))
    return {case.id.removeprefix("benchmark-"): case for case in found}


def processor_seconds():
    """Return the processor time of this process and of the programs that it ran."""
    of_programs = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + of_programs.ru_utime + of_programs.ru_stime


def solve(case, method, hardness):
    """Return the result at each load of a case, with its fields.

    Args:
        case: the case of a scene.
        method: name of a method.
        hardness: "effective", "3" for three yield stresses, or "" for J2 flow.
    """
    scene = case.scene(case.recipes[0])
    caps = [math.inf] * len(scene.load.path)
    if hardness == "3":
        caps = [3 * scene.material.yield_stress] * len(caps)
    elif hardness:
        # The cap of the largest load so far; the map is also asked beyond its bodies.
        peaks = itertools.accumulate(scene.load.path, max)
        caps = [case.cap_at(rms_slope(scene), peak).value for peak in peaks]
    options = {"persson": THEORY, "bem": {}}.get(method, case.options["fem"])
    if method == "persson" and case.id.endswith("sphere"):
        raise InvalidScene("a single bump is no random roughness")
    found = []
    pairs = zip(caps, scene.load.path, strict=True)
    for cap, group in itertools.groupby(pairs, key=lambda pair: pair[0]):
        loads = tuple(load for _, load in group)
        material = replace(scene.material, hardness=cap)
        part = replace(scene, material=material, load=Load(loads))
        result = METHODS[method].solve(part, options, 1, found.append)
        if method == "persson":
            found += [replace(result, steps=(step,)) for step in result.steps]
    return found


def solve_and_time(case, code):
    """Return the results of a code at each load of a case, and its processor time in s.

    Repeated runs, of which the fastest one counts, are up to TIMED.
    """
    seconds = []
    while not seconds or sum(seconds) < TIMED:
        started = processor_seconds()
        found = solve(case, *CODES[code])
        seconds.append(processor_seconds() - started)
    return found, min(seconds)


def row_of(step, method):
    """Return the columns of a load step in results.csv: fractions of the nominal area,
    m and Pa; NaN where a method does not have a quantity, as tamaas where metal flowed.
    """
    raw = step.areas["raw"]
    limit = step.areas.get("corrected")
    error = step.areas.get("error")
    flowed = math.nan if method == "tamaas_j2" else raw.plastic
    return {
        "area": raw.total,
        "flowed": flowed,
        "area_limit": limit.total if limit else math.nan,
        "area_limit_error": error.total if error else math.nan,
        "mean_gap": step.quantities.get("mean_gap", math.nan),
        "largest_pressure": step.quantities.get("largest_pressure", math.nan),
    }


def write_results(code, name, case):
    """Solve the case of a scene by a code and write its results."""
    try:
        found, seconds = solve_and_time(case, code)
    except EpcontactError as error:
        print(f"{code} on {name}: {error}", flush=True)
        return
    print(f"{code} on {name}: {seconds:.3g} s", flush=True)
    rows = []
    fields = []
    for number, result in enumerate(found, 1):
        step = result.final
        row = {"scene": name, "load": number, "code": code}
        row |= {"mean_pressure": step.mean_pressure, "seconds": seconds}
        rows.append(row | row_of(step, result.method))
        if "pressure" in result.fields:
            pressure = result.fields["pressure"]
            i, j = np.indices(pressure.shape)
            points = {"i": i.ravel(), "j": j.ravel(), code: pressure.ravel()}
            fields.append(pd.DataFrame({"scene": name, "load": number, **points}))
    write_merged("results.csv", ROW, pd.DataFrame(rows))
    if fields:
        write_merged("pressures.csv", POINT, pd.concat(fields))


def write_sources():
    """Write what makes boundary elements differ from the elements with J2 flow.

    The parts are those of `crosscheck.error_budget`, for each load beyond all earlier
    ones and both hardnesses, and the effect of half as many increments on J2 flow.
    """
    rows = []
    for name, case in cases().items():
        scene = case.scene(case.recipes[0])
        options = case.options["fem"]
        block = {key: options[key] for key in ("depth", "layers")}
        found = solve(case, "fem", "")
        fewer = []
        changed = {**options, "steps": options["steps"] // 2}
        METHODS["fem"].solve(scene, changed, 1, fewer.append)
        peaks = [0.0, *itertools.accumulate(scene.load.path, max)]
        for number, load in enumerate(scene.load.path, 1):
            if load <= peaks[number - 1]:
                continue
            j2 = found[number - 1]
            parts = {("", "increments"): difference(fewer[number - 1], j2, math.inf)}
            for hardness in ("effective", "3"):
                cap = 3 * scene.material.yield_stress
                if hardness == "effective":
                    cap = case.cap_at(rms_slope(scene), load).value
                material = replace(scene.material, hardness=cap)
                capped = replace(scene, material=material, load=Load(load))
                budget = error_budget(capped, "capped", j2, **block)
                parts |= {(hardness, part): away for part, away in budget.items()}
            for (hardness, part), away in parts.items():
                row = {"scene": name, "load": number, "hardness": hardness}
                row |= {"part": part, "area": away.area, "field": away.pressure}
                rows.append(row | {"distribution": away.wasserstein})
    table = pd.DataFrame(rows)
    table.to_csv(FOLDER / "sources.csv", index=False, float_format="%.4g")


def write_merged(file, keys, new):
    """Write a table into a CSV file, whose rows and columns of other keys remain.

    Scenes and codes are in the order of the case file and of CODES.
    """
    path = FOLDER / file
    new = new.set_index(keys)
    if path.is_file():
        new = new.combine_first(pd.read_csv(path).set_index(keys))
    places = {name: number for number, name in enumerate([*cases(), *CODES])}
    table = new.sort_index(key=lambda level: level.map(lambda v: places.get(v, v)))
    if "code" not in keys:
        table = table[[name for name in CODES if name in table]]
    table.to_csv(path, float_format="%.5g")


def main(words):
    """Write heights and scenes, the sources of error, or results of codes on scenes."""
    if words == ["heights"]:
        write_heights()
        write_scenes()
    elif words == ["sources"]:
        write_sources()
    codes = [word for word in words if word in CODES]
    for code in codes:
        METHODS[CODES[code][0]].load()
        for name, case in cases().items():
            if name in words or words == codes:
                write_results(code, name, case)


if __name__ == "__main__":
    main(sys.argv[1:])
