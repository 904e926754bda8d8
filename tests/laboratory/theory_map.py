"""The laboratory of the theory's error: it makes the map `persson/theory_map.csv`.

The scenes are the sweeps of `cases/theory-map.toml`: boundary elements and the theory
at places of the plane of p0/hardness (without a hardness: of p0/(E* xi)) and
hardness/(E* xi), for several spectra.  The columns are the mean figure of the boundary
elements (corrected areas over the nominal one, gap over the rms height), `_scatter`,
its relative standard error over the surfaces, `_grid`, the relative error of the areas
by the grid, `_theory`, the relative error of the theory with one gamma, and
`_near_bounds`, that of the theory with this rule.  Slopes have `_scatter` and `_theory`
alone, and the Wasserstein distance is that of the mean distribution
from the theory's.  The pressures lose at each end what the correction takes from its
area.

`python -m laboratory.theory_map --size large` makes the map of the package in some half
an hour of one core (`fast`: a small one that shows how), and solves no scene again that
`--output` holds. `--judge 470 640` counts how often the intervals of `persson.validity`
hold the errors in scenes of other spectra, surfaces and places; its constants were
chosen on the scenes 0 to 469 and, of `--kind light` (light loads of 64 to 256 waves),
2000 to 8199.  With `--near-bounds` it judges the intervals of that rule, whose
constants were chosen on the scenes 0 to 199 of the kinds any and light-few-waves.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import pandas as pd

from epcontact import Load, Material, Scene, SelfAffineSpectrum, bem, persson
from epcontact.errors import InvalidScene
from epcontact.harness.gates import distance
from epcontact.harness.solving.saved import load_saved
from epcontact.materials.moduli import effective_modulus
from epcontact.persson import (
    EnergyReduction,
    Theory,
    analytic_roughness,
    roughness_of,
    validity,
)
from epcontact.persson.clipped_pressure import displacements
from epcontact.persson.near_bounds import CONSTANTS
from epcontact.persson.separation import mean_separation
from epcontact.results import PressureDistribution
from epcontact.studies.paper_scene import LOWEST, MODULUS
from epcontact.surfaces import SelfAffine
from laboratory import maps

PLACE = ["hurst", "wavelength_ratio", "roll_off", "hardness", "load"]
PARTS = ("total", "elastic", "plastic")
#: Slopes are means within this share of the smaller of hardness and E* xi, below a
#: hardness of which (over E* xi) the points next to a rim fill the window on four
#: points a wave.
WINDOW = 0.2
LEAST = 0.6
HEADER = """\
# The theory's error; tests/laboratory/theory_map.py says what the columns are.
# Made by `python -m laboratory.theory_map --size {size}` with {versions}.
"""


def make_map(size, output, jobs=None):
    """Solve the scenes of a size ("fast" or "large") that `output` does not hold yet;
    return the map as a table, and its file.
    """
    rows = []
    for sweep in maps.solved("theory-map", size, output, jobs):
        places = {}
        for task, point in zip(sweep.tasks, sweep.points, strict=True):
            places.setdefault(str(point), []).append(task)
        rows += [place_row(tasks, output) for tasks in places.values()]
    made = pd.DataFrame(rows)
    path = output / "theory-map" / size / "theory_map.csv"
    maps.write(path, size, HEADER, made.to_csv(index=False, float_format="%.5g"))
    return made, path


def place_row(tasks, output):
    """Return one row of the map as a dictionary: the relative errors of the theory at
    one place, with their standard errors and the estimated grid errors.

    `tasks` are the solved tasks of the place, of both methods, with results in
    `output`.
    """
    (theory,) = (
        load_saved(task, output) for task in tasks if task.method.name == "persson"
    )
    found = [load_saved(task, output) for task in tasks if task.method.name == "bem"]
    case = tasks[0].case
    spectrum = tasks[0].recipe.spectrum
    unit = effective_modulus(case.material) * spectrum.rms_slope
    hardness = case.material.hardness
    scale = hardness if math.isfinite(hardness) else unit
    low, mid, high = (
        getattr(spectrum, f"wavenumber_{k}") for k in ("low", "roll_off", "high")
    )
    place = (spectrum.hurst, high / low, mid / low, hardness / unit)
    row = dict(zip(PLACE, (*place, theory.final.mean_pressure / scale), strict=True))
    row["surfaces"] = len(found)
    near_bounds = Theory(
        analytic_roughness(spectrum),
        effective_modulus(case.material),
        EnergyReduction(CONSTANTS[0], "near_bounds"),
        hardness,
    )
    by_bounds = near_bounds.contact_areas(theory.final.mean_pressure)
    for part in PARTS:
        exact = getattr(theory.final.areas["raw"], part)
        values = [getattr(result.final.areas["corrected"], part) for result in found]
        claim = np.mean(
            [getattr(result.final.areas["error"], part) for result in found]
        )
        known = np.mean(values) > claim  # else the grid does not resolve it
        row |= figures(part, exact, values if known else [math.nan])
        row[f"{part}_grid"] = claim / np.mean(values) if known else math.nan
        row[f"{part}_near_bounds"] = getattr(by_bounds, part) / row[part] - 1
    # Gaps hang on the longest waves, of which a period holds a few, and not a
    # continuous spectrum.
    rough, height = own_roughness(tasks[0].recipe)
    reduction = EnergyReduction(case.options["persson"]["energy_reduction"])
    own = Theory(rough, effective_modulus(case.material), reduction, hardness)
    gaps = [result.final.quantities["mean_gap"] / height for result in found]
    row |= figures(
        "mean_gap", mean_separation(own, theory.final.mean_pressure) / height, gaps
    )
    gap = displacements(own, theory.final.mean_pressure).mean_gap / height
    row["mean_gap_near_bounds"] = gap / row["mean_gap"] - 1
    pressures = [corrected(result) for result in found]
    row |= distances(pressures, theory.distribution, hardness)
    width = WINDOW * min(hardness, unit)
    exact = end_shares(theory.distribution, width)
    measured = np.transpose([end_shares(one, width) for one in pressures])
    for end, share, values in zip(("zero", "hardness"), exact, measured, strict=True):
        wall = end == "zero" or math.isfinite(hardness)
        known = wall and hardness >= 0.99 * LEAST * unit and np.mean(values) > 1e-5
        row |= figures(f"slope_at_{end}", share, values if known else [math.nan])
        del row[f"slope_at_{end}"]
    return row


@functools.lru_cache(maxsize=1)
def own_roughness(recipe):
    """Return the roughness of a surface's own Fourier modes, and its rms height in
    m.
    """
    surface = recipe.build()
    return roughness_of(surface, "surface"), surface.rms_height


def figures(name, exact, values):
    """Return the mean of a quantity over surfaces, its relative standard error, and the
    relative error of the theory.

    `values` has one number for each surface, and `exact` is the theory's; the keys of
    the dictionary begin with `name`.
    """
    mean = np.mean(values)
    deviation = math.nan
    if len(values) > 1:
        deviation = np.std(values, ddof=1) / math.sqrt(len(values))
    return {
        name: mean,
        f"{name}_scatter": deviation / mean,
        f"{name}_theory": exact / mean - 1,
    }


def corrected(result):
    """Return the distribution of a result's pressures, without the area by which the
    raw areas exceed the corrected ones.
    """
    raw, areas = (result.final.areas[kind] for kind in ("raw", "corrected"))
    known = result.distribution
    share = np.clip(known.cumulative - (raw.total - areas.total), 0, areas.elastic)
    return PressureDistribution(known.pressure, share, areas.plastic)


def distances(pressures, exact, hardness):
    """Return the Wasserstein distance of the surfaces' mean distribution from the
    theory's, and its relative error by the jackknife.

    `pressures` are the distributions of the surfaces, `exact` is the theory's, and
    `hardness` (Pa) the unit of the distance.
    """
    sigma = np.unique(np.concatenate([one.pressure for one in pressures]))
    shares = np.array(
        [np.interp(sigma, one.pressure, one.cumulative) for one in pressures]
    )
    plastic = np.array([one.plastic for one in pressures])

    def off(used):
        """Return the distance between the theory's distribution and the mean of the
        surfaces in the mask `used`.
        """
        mean = PressureDistribution(sigma, shares[used].mean(0), plastic[used].mean())
        return distance("wasserstein", exact, mean, hardness)

    n = len(pressures)
    without = [off(np.arange(n) != left) for left in range(n)] if n > 1 else [math.nan]
    error = math.sqrt((n - 1) * np.var(without))
    whole = off(np.arange(n))
    return {"wasserstein": whole, "wasserstein_scatter": error / whole}


def end_shares(known, width):
    """Return the area fractions with a pressure within `width` (Pa) of zero, and within
    `width` of the upper end.
    """
    top = known.pressure[-1] - width
    low, high = np.interp([width, top], known.pressure, known.cumulative)
    return low, known.cumulative[-1] - high


def random_scene(number, wide=(16, 128), heaviest=2.2):
    """Return a random scene whose spectrum, surface and place are none of the map's.

    Args:
        number: seed of the scene.
        wide: least and greatest number of the shortest waves a period.
        heaviest: largest logit of the load over the hardness.
    """
    random = np.random.default_rng([32, number])
    hurst = round(random.uniform(0.25, 0.98), 3)
    roll = float(random.choice([1, 2, 4, 6]))
    ends = max(wide[0], 4 * roll), wide[1]
    wide = round(float(np.exp(random.uniform(*np.log(ends)))))
    elastic = random.random() < 0.15
    hardness = math.inf
    if not elastic:
        hardness = float(np.exp(random.uniform(*np.log([0.06, 3.0]))))
    share = 1 / (1 + math.exp(-random.uniform(-6.2, heaviest)))
    load = share * hardness
    if elastic:
        largest_load = 0.8 if heaviest > 0 else 0.05
        load = float(np.exp(random.uniform(*np.log([0.005, largest_load]))))
    spectrum = SelfAffineSpectrum(hurst, LOWEST, roll * LOWEST, wide * LOWEST, 1.0)
    periods = (2 * math.pi / LOWEST,) * 2
    # On 4 points a wave the elastic area of soft bodies is wrong by up to a half.
    points_per_wave = 8 if hardness <= 0.3 else 4
    points = (points_per_wave * wide,) * 2
    surface = SelfAffine(spectrum, periods, points, 5000 + number).build()
    return Scene(
        surface, Material(MODULUS, 0.0, hardness * MODULUS), Load(load * MODULUS)
    )


def judged(scene, spectrum="analytic", **rule):
    """Return a row for each quantity of a scene: the theory's error, the ends of its
    expected interval, and whether the interval holds the error.

    `spectrum` is that of the interval, `rule` are options of the theory. The list is
    empty outside of the map.
    """
    rule = rule or {"energy_reduction": validity.GAMMA}
    theory = Theory.of_scene(scene, spectrum=spectrum, **rule)
    try:
        found = validity.expected_errors(theory, scene.load.final)
    except InvalidScene:
        return []
    solved = bem.solve(scene, area_tolerance=1e-5, threads=1).final
    told = persson.solve(scene, spectrum="surface", **rule).final
    exact, mine = (
        vars(step.areas["corrected"]) | {"mean_gap": step.quantities.get("mean_gap")}
        for step in (solved, told)
    )
    rows = []
    for figure in validity.LISTED.keys() & found.keys():
        if exact[figure] > 0:
            error = mine[figure] / exact[figure] - 1
            low, _, high = found[figure]
            held = low <= error <= high
            rows.append(
                {"figure": figure, "error": error, "held": held, "ends": (low, high)}
            )
    return rows


#: Least and greatest number of shortest waves a period, and the largest logit of the
#: load over the hardness, of each kind of random scenes.
KINDS = {
    "any": ((16, 128), 2.2),
    "light": ((64, 256), -4.0),
    "light-few-waves": ((16, 64), -3.0),
}


def judge(first, last, kind="any", near_bounds=False):
    """Print how often the map's intervals hold the theory's errors on random scenes
    `first` to `last` - 1, and how wide the intervals are.

    `kind` is one of KINDS; `near_bounds` takes the rule of this name.
    """
    rule = {}
    if near_bounds:
        rule = {"energy_reduction": CONSTANTS[0], "reduction": "near_bounds"}
    rows = []
    for number in range(first, last):
        rows += judged(random_scene(number, *KINDS[kind]), **rule)
    table = pd.DataFrame(rows)
    low, high = np.transpose([*table["ends"]])
    table["width"] = (high - low) / 2
    table["error"] = table["error"].abs()
    groups = table.groupby("figure")
    shown = groups["held"].agg(["size", "mean"])
    shown["median half-width"] = groups["width"].median()
    shown["median error"] = groups["error"].median()
    shown["95 % of errors"] = groups["error"].quantile(0.95)
    print(shown.round(4).to_string())
    print(
        f"{len(table)} errors, {table['held'].mean():.3f} of them within the interval"
    )


def main():
    """Make the map of a size, or judge the one of the package."""
    parser = maps.parser("theory_map")
    parser.add_argument(
        "--judge", type=int, nargs=2, help="random scenes, from one to another"
    )
    parser.add_argument("--kind", choices=KINDS, default="any", help="of the scenes")
    parser.add_argument("--near-bounds", action="store_true", help="the other rule")
    given = parser.parse_args()
    if given.judge:
        return judge(*given.judge, given.kind, given.near_bounds)
    made, path = make_map(given.size, given.output, given.jobs)
    return print(f"{len(made)} places in {path}")


if __name__ == "__main__":
    main()
