"""Coverage of the errors that a measured map's form, edges and holes cause.

Each map is one whole period of a known surface.  For "form" it lies tilted, and is
mirrored and levelled as a file is; the truth is the period with its own plane.  For
"holes" some points are missing, and the truth is the same treated map without holes.
The unit of length is the grid spacing, E* is 1, the rms slope 0.05 and the hardness
0.01.  `epcontact.alternatives.FACTOR` comes from CALIBRATION; JUDGED are kinds, seeds,
holes and fractions that it was not derived from.

`python -m laboratory.measured_maps [form|holes] [--calibration]` prints coverage by
kind: without the parts "form" and "missing", and with them, and the median ratio of
error estimate to error; two minutes of one core.  With `--largest 9216` the
alternatives are solved on every second point, with 2304 on every fourth, as those of
maps above `epcontact.alternatives.LARGEST_GRID` are.
"""

from __future__ import annotations

import argparse
import itertools
import math
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import ndimage

from epcontact import alternatives, bem
from epcontact.alternatives import (
    on_coarser_grid,
    with_measurement_errors,
    without_alternatives,
)
from epcontact.errors import EpcontactError
from epcontact.harness.quantities.registry import measure_all
from epcontact.scene import Load, Material, Scene, Surface, rms_slope
from epcontact.studies.paper_scene import self_affine
from epcontact.surfaces import HeightsFromArray
from epcontact.surfaces.profiles import profile_map
from epcontact.surfaces.treatment import prepare_surface

SLOPE, HARDNESS = 0.05, 0.01
#: Mean pressures over the hardness.
LOADS = (0.02, 0.1, 0.3)
AREAS = ("total_area", "elastic_area", "plastic_area")
MEASURED = (
    "conductance",
    "stiffness_unloading",
    "contact_percolation",
    "gap_percolation",
)


def rough(n, seed, hurst=0.8, roll_off=1.0, points=4):
    """Return self-affine heights (n, n).

    `roll_off` is the number of the longest self-affine waves in a period, and `points`
    that of the points of the shortest waves.
    """
    return self_affine(
        2 * math.pi / n, (n, n), seed, n / points, roll_off, hurst=hurst
    ).heights


def rolled(n, seed):
    """Return heights (n, n) with a roll-off at 24 points."""
    return rough(n, seed, 0.8, n / 24)


def hurst5(n, seed):
    """Return heights (n, n) of Hurst exponent 0.5 without a roll-off."""
    return rough(n, seed, 0.5)


def hurst3(n, seed):
    """Return heights (n, n) of Hurst exponent 0.3 without a roll-off."""
    return rough(n, seed, 0.3)


def hurst8(n, seed):
    """Return heights (n, n) of Hurst exponent 0.8, with 8 points a shortest wave."""
    return rough(n, seed, points=8)


def _oblong(n, seed, along):
    """Return roughness (n, n) with waves that are longer in one direction.

    `along` has the wave number in that direction for each mode of `numpy.fft.rfft2`.
    """
    modes = np.fft.rfft2(rough(n, seed, 0.75, 1.5))
    return np.fft.irfft2(modes / (1 + (along / 2) ** 2), (n, n))


def ground(n, seed):
    """Return heights (n, n) of a ground surface, whose waves are long along x."""
    return _oblong(n, seed, np.fft.fftfreq(n, 1 / n)[:, None])


def lay(n, seed):
    """Return heights (n, n) whose waves are long along a diagonal."""
    return _oblong(n, seed, np.fft.fftfreq(n, 1 / n)[:, None] + np.arange(n // 2 + 1))


def plateaus(n, seed):
    """Return heights (n, n) with worn summits, which are rough themselves."""
    heights = rough(n, seed, 0.8, 3.0)
    worn = np.minimum(heights, 0.3 * heights.std())
    return worn + 0.1 * rough(n, seed + 77, 0.8, 8.0)


def ridged(n, seed):
    """Return heights (n, n) with a positive skewness."""
    heights = rolled(n, seed)
    return np.expm1(0.7 * heights / heights.std())


def _squares(n, centre):
    """Return the squared distances (n, n) from a centre, on the periodic grid."""
    u, v = ((np.arange(n) - c + n / 2) % n - n / 2 for c in centre)
    return u[:, None] ** 2 + v**2


def spheres(n, seed, count):
    """Return heights (n, n) of `count` spheres whose tops have random heights."""
    rng = np.random.default_rng(seed)
    heights = np.full((n, n), -3.0)
    for _ in range(count):
        top = -_squares(n, rng.uniform(0, n, 2)) / n
        heights = np.maximum(heights, top + rng.uniform(0, 1.0))
    return heights


def spheres9(n, seed):
    """Return heights (n, n) of nine spheres."""
    return spheres(n, seed, 9)


def spheres25(n, seed):
    """Return heights (n, n) of 25 spheres."""
    return spheres(n, seed, 25)


def dimples(n, seed):
    """Return heights (n, n) of overlapping dents, with roughness."""
    rng = np.random.default_rng(seed)
    dents = np.zeros((n, n))
    for _ in range(n * n // 154):
        depth = rng.uniform(5, 14) ** 2 - _squares(n, rng.uniform(0, n, 2))
        dents -= rng.uniform(0.3, 1) * np.maximum(depth, 0) / 4
    fine = rolled(n, seed)
    return dents / rms_slope(dents, (1.0, 1.0)) + 0.4 * fine


def grains(n, seed):
    """Return heights (n, n) of 40 domed grains with steps between them."""
    rng = np.random.default_rng(seed)
    distances = [_squares(n, rng.uniform(0, n, 2)) for _ in range(40)]
    levels = rng.normal(0, 0.6, 40)
    nearest = np.argmin(distances, axis=0)
    heights = levels[nearest] - np.min(distances, axis=0) / (0.8 * n)
    return ndimage.gaussian_filter(heights, 1.0, mode="wrap")


CALIBRATION = (rolled, hurst5, plateaus, ground, spheres9)
JUDGED = (hurst3, hurst8, grains, lay, dimples, ridged, spheres25)


def period(kind, n, seed):
    """Return heights (n, n) of a kind with mean 0 and the rms slope SLOPE."""
    heights = kind(n, seed)
    return (heights - heights.mean()) * (SLOPE / rms_slope(heights, (1.0, 1.0)))


# --- holes


def hole_mask(heights, kind, fraction, seed):
    """Return the mask of the points that an instrument does not see.

    `kind` is one of HOLES, and `fraction` that of the points.
    """
    rng = np.random.default_rng(seed)
    n = len(heights)
    if kind == "borders":
        mask = np.zeros(heights.shape, bool)
        width = max(round(fraction * n / 2), 1)
        mask[:width] = True
        mask[:, -width:] = True
        return mask
    noise = rng.normal(size=heights.shape)
    score = {
        "tops": heights,
        "flanks": np.hypot(*np.gradient(heights)),
        "speckle": noise,
        "blobs": ndimage.gaussian_filter(noise, 4, mode="wrap"),
        "speckled tops": heights / heights.std() + noise,
    }[kind]
    return score > np.quantile(score, 1 - fraction)


HOLES = ("tops", "flanks", "speckle", "blobs", "borders", "speckled tops")


# --- solves


def solved(surface, measured=MEASURED, loads=LOADS):
    """Return the load steps of a surface with its errors, and the measured quantities.

    Each load is solved on the unloaded surface; `loads` are over the hardness.
    """
    steps = []
    for load in loads:
        scene = Scene(surface, Material(1.0, 0.0, HARDNESS), Load(load * HARDNESS))
        step = _step(without_alternatives(scene), measured)
        step = step.with_errors(surface.treatment_errors, "treatment")
        compared_scene = on_coarser_grid(scene)
        base = [step]
        if compared_scene is not scene:
            base = [_step(without_alternatives(compared_scene), measured)]
        (step,) = with_measurement_errors(
            compared_scene, [step], lambda changed: [_step(changed, measured)], base
        )
        steps.append(step)
    return steps


def _step(scene, measured):
    """Return the load step of a scene with measured quantities and their errors."""
    result = bem.solve(scene, threads=1, area_tolerance=1e-4)
    names = [f"quantity.{name}{end}" for name in measured for end in ("", ".error")]
    try:
        values = measure_all(names, scene, result)
    except EpcontactError:
        values = {}
    quantities = {n.removeprefix("quantity."): v for n, v in values.items()}
    return replace(result.final, quantities={**result.final.quantities, **quantities})


def compared(step, truth, sources):
    """Yield for each value of a step: its name, its error, and its error estimates
    without and with `sources`, all over the value (areas over the total area).
    """
    row = step.row
    exact = truth.row
    for name in (*AREAS, "mean_gap", *MEASURED):
        if name not in row or name not in exact:
            continue
        scale = exact["total_area"] if name in AREAS else abs(exact[name])
        parts = {n: v for n, v in row.items() if n.startswith(f"{name}_error_by_")}
        with_all = math.hypot(*parts.values(), 0.0)
        before = [v for n, v in parts.items() if not n.endswith(sources)]
        yield {
            "value": name,
            "error": abs(row[name] - exact[name]) / scale,
            "before": math.hypot(*before, 0.0) / scale,
            "estimate": with_all / scale,
        }


def of_form(kinds, seeds, n=96, order=1):
    """Return rows of values of tilted, mirrored periods against the periods.

    `order` is that of the polynomial that is removed, 1 or 2.  With 2, the map is also
    curved, by as much as it is tilted.
    """
    rows = []
    index = np.arange(n)
    for kind, seed in itertools.product(kinds, seeds):
        heights = period(kind, n, seed)
        tilted = heights + SLOPE * (index[:, None] - 0.6 * index)
        if order == 2:
            tilted += (
                SLOPE * (index[:, None] - 0.5 * index) * (index[:, None] + index) / n
            )
        surface = HeightsFromArray(tilted, (n, n), "mirrored", form=order).build()
        truth = solved(Surface(heights, (n, n)))
        for step, exact in zip(solved(surface), truth, strict=True):
            found = compared(step, exact, ("form",))
            rows += [{"kind": kind.__name__, "of": "form", **row} for row in found]
    return pd.DataFrame(rows)


def of_holes(kinds, seeds, holes, fractions, n=96):
    """Return rows of values of maps with holes against the maps without holes.

    `holes` are names in HOLES, `fractions` those of the missing points.  Loads at which
    no area is claimed have an infinite estimate.
    """
    rows = []
    loads = (0.03, 0.2)
    for kind, seed in itertools.product(kinds, seeds):
        heights = period(kind, n, seed)
        surface = HeightsFromArray(heights, (n, n), "mirrored").build()
        truth = solved(replace(surface, alternatives=()), (), loads)
        for name, fraction, fill in itertools.product(
            holes, fractions, ("harmonic", "nearest")
        ):
            given = heights.copy()
            given[hole_mask(heights, name, fraction, seed)] = np.nan
            surface = HeightsFromArray(given, (n, n), "mirrored", missing=fill).build()
            # The treatment of the edges is the same in the truth.  The plane is not.
            surface = replace(surface, treatment_errors={})
            for step, exact in zip(solved(surface, (), loads), truth, strict=True):
                found = compared(step, exact, ("missing", "form"))
                rows += [{"kind": kind.__name__, "of": name, **row} for row in found]
    return pd.DataFrame(rows)


def uneven_steps(kind, n, seed):
    """Return increasing coordinates (n,) from 0 to n - 1 with uneven steps.

    `kind` is one of STEPS: each point is off its place by up to .4 steps; anywhere;
    steps that go up and down by 60 %; of two lengths; or that grow to six times.
    """
    rng = np.random.default_rng(seed)
    index = np.arange(n)
    x = {
        "jitter": index + rng.uniform(-0.4, 0.4, n),
        "random": rng.uniform(0, n, n),
        "drift": np.cumsum(1 + 0.6 * np.sin(6 * np.pi * index / n)),
        "two": np.cumsum(np.where(index < n / 2, 0.6, 1.4)),
        "growing": np.cumsum(np.linspace(0.3, 1.7, n)),
    }[kind]
    x = np.sort(x) - x.min()
    return x * (n - 1) / x.max()


STEPS = ("jitter", "random", "drift", "two", "growing")


def of_profiles(steps, seeds, n=300):
    """Return rows of values of profiles with uneven steps against even fine profiles.

    `steps` are names in STEPS.  The waves have 4 or 8 points, the Hurst exponent is .3
    or .8, and every second profile has noise of .6 % of its rms height.
    """
    rows = []
    loads = (0.2, 0.5)
    for kind, points, hurst, seed in itertools.product(
        steps, (4, 8), (0.3, 0.8), seeds
    ):
        rng = np.random.default_rng([seed, points])
        waves = np.arange(1, n // points + 1)
        phases = rng.uniform(0, 2 * np.pi, waves.size)
        amplitudes = waves ** (-hurst - 0.5) / 1.37
        rise = SLOPE / math.sqrt(np.sum((amplitudes * waves * 2 * np.pi / n) ** 2) / 2)

        def heights(x, waves=waves, phases=phases, amplitudes=amplitudes * rise, n=n):
            """Return the heights of the line at x; it does not repeat after n."""
            return (
                np.cos(2 * np.pi / 1.37 / n * np.outer(x, waves) + phases) @ amplitudes
            )

        even = np.linspace(0, n - 1, 4 * n)
        exact = HeightsFromArray(heights(even), (n - 1.0,), "mirrored").build()
        x = uneven_steps(kind, n, seed)
        given = heights(x)
        given += 0.006 * (seed % 2) * given.std() * rng.normal(size=n)
        stored = profile_map(x, given)
        recipe = HeightsFromArray(
            stored.heights, stored.periods, "mirrored", missing="harmonic"
        )
        surface = prepare_surface(
            stored.heights, recipe, "heights", otherwise=stored.otherwise
        )
        interpolated = [a for a in surface.alternatives if a.source == "missing"]
        surface = replace(
            surface, treatment_errors={}, alternatives=tuple(interpolated)
        )
        truth = solved(replace(exact, alternatives=()), (), loads)
        for step, exact_step in zip(solved(surface, (), loads), truth, strict=True):
            found = compared(step, exact_step, ("missing", "form"))
            rows += [{"kind": kind, "of": f"{points} points", **row} for row in found]
    return pd.DataFrame(rows)


def coverage(rows, by):
    """Return a table of the percentage of values within their estimates, before and
    now, by value and another column, with the percentage of claimed values.
    """
    rows = rows.assign(
        before=100 * (rows["error"] <= rows["before"] + 1e-9),
        now=100 * (rows["error"] <= rows["estimate"] + 1e-9),
        claimed=100 * np.isfinite(rows["estimate"]),
        ratio=rows["estimate"] / rows["error"],
    )
    claimed = rows[rows["claimed"] > 0].groupby(["value", by])
    table = claimed[["before", "now"]].mean()
    table["ratio"] = claimed["ratio"].median()
    table["claimed"] = rows.groupby(["value", by])["claimed"].mean()
    return table


def main():
    """Print the tables of coverage that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m laboratory.measured_maps")
    parser.add_argument("of", choices=["form", "form2", "holes", "profiles"])
    parser.add_argument("--calibration", action="store_true")
    parser.add_argument("--largest", type=int, default=alternatives.LARGEST_GRID)
    given = parser.parse_args()
    alternatives.LARGEST_GRID = given.largest
    warnings.simplefilter("ignore")
    kinds = CALIBRATION if given.calibration else JUDGED
    first = 1 if given.calibration else 301
    if given.of.startswith("form"):
        order = 2 if given.of == "form2" else 1
        rows = of_form(kinds, range(first, first + 6), order=order)
        tables = [coverage(rows, "kind")]
    elif given.of == "profiles":
        tables = [coverage(of_profiles(STEPS, range(first, first + 4)), "kind")]
    else:
        fractions = (0.003, 0.02, 0.1, 0.27) if given.calibration else (0.01, 0.05, 0.2)
        names = HOLES[:4] if given.calibration else HOLES
        rows = of_holes(kinds, range(first + 100, first + 102), names, fractions)
        tables = [coverage(rows, "of"), coverage(rows, "kind")]
    for table in tables:
        print(table.unstack(0).round(1).to_string())


if __name__ == "__main__":
    main()
