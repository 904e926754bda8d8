"""Measure the constants of the limits of stiffness and conductance.

The constants are CONSTANTS, SMOOTH, STEP_SETBACK and STEP_ERROR of
`epcontact.interface.rim`.  They are fitted to the kinds of surfaces in FITTED_KINDS.
They are judged on those in JUDGED_KINDS: the kinds of `laboratory.areas`,
roughness with its ridges along the grid, and unloaded contacts.  Grids have 3 to 16
points a shortest wavelength, and the reference is the limit from a finer grid.

`intensity` and `setback` minimise the mean logarithm of the error.  `random_error` and
`area_factor` minimise the mean of

    ln(estimate) + max(0, ln(error/estimate))/(1 - COVERED),

where the estimate is that of the error.  STEP_SETBACK is measured on punches that are
discs, which have a closed form.

`python -m laboratory.interface` prints the constants in use, those that the ensemble
and its halves give, and the table of the judged kinds, in fifteen minutes of one core.

Random errors average out on long rims, and the systematic error does not.  On roughness
with 16 to 128 shortest waves a period and four points on each wave, the limit stays .5
to 1 % below that of 16 points.  This gives `systematic_error`, which `python -m
laboratory.interface waves` judges in ten minutes of one core.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.signal import resample

from epcontact import EpcontactError, Load, Material, Scene, Surface, bem
from epcontact.interface.rim import (
    CONSTANTS,
    SMOOTH,
    STEP_ERROR,
    STEP_SETBACK,
    measure_punch,
    stiffness_limit,
)
from epcontact.interface.stiffness import carrying_points
from epcontact.reference.posts import FLAT_PUNCH
from epcontact.studies.conductance import joint_scene
from laboratory.areas import KINDS, by_name, member, roughness

#: The fraction of errors that are to be smaller than their estimates.
COVERED = 0.94
#: Added to relative errors and estimates before their logarithms are taken.
_LEAST = 3e-4
#: Seeds, points a side, and points of the reference's grid for each of them.  On larger
#: grids the random errors are smaller, with the root of the length of the rim.
FITTED_ON = ((range(1000, 1030), 48, 8), (range(2000, 2004), 160, 4))
JUDGED_ON = ((range(100, 125), 48, 8),)
#: Contacts fuller than this have too little rim to learn from.
_FULLEST = 0.9
#: The quantity of each branch.
QUANTITIES = {"unloading": "conductance", "loading": "stiffness_loading"}


def _waves(patch, rng, count=60):
    """Return `count` random waves on the grid of `patch`, with half to all of the
    highest wavenumber and an rms slope of 1; `rng` is a numpy generator.
    """
    x, y = patch.offsets()
    heights = np.zeros(patch.shape)
    square_slope = 0.0
    for _ in range(count):
        size = rng.uniform(0.5, 1)
        turn = rng.uniform(0, 2 * np.pi)
        phase = rng.uniform()
        a = round(patch.high * size * math.cos(turn))
        b = round(patch.high * size * math.sin(turn))
        heights += np.cos(2 * np.pi * (a * x + b * y + phase))
        square_slope += 2 * np.pi**2 * (a * a + b * b)
    return heights / math.sqrt(square_slope)


def _terraces(patch, rng):
    """Return roughness (the shape of `patch`) on two levels whose edge follows long
    random waves.
    """
    coarse = replace(patch, high=3)
    above = _waves(coarse, rng) > rng.uniform(-0.05, 0.05)
    return rng.uniform(0.1, 0.5) * _waves(patch, rng) + rng.uniform(0.01, 0.1) * above


def _ripples(patch, rng):
    """Return two sinusoids in different random directions on the grid of `patch`."""
    x, y = patch.offsets()
    heights = np.zeros(patch.shape)
    for slope in (1.0, rng.choice([0.0, 0.3, 1.0])):
        a, b = rng.choice([[1, 0], [0, 3], [1, 2], [2, 2], [4, 1]])
        wave = np.cos(2 * np.pi * (a * x + b * y + rng.uniform()))
        heights = heights + slope * wave / (2 * np.pi * math.hypot(a, b))
    return heights


def _ellipsoids(patch, rng):
    """Return heights (the shape of `patch`) of a few elliptic summits, turned at
    random.
    """
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(2, 7))):
        along, across = _turned(patch, rng)
        bent = along**2 * rng.uniform(1, 5) + across**2 * rng.uniform(1, 5)
        heights = np.maximum(heights, rng.uniform(0, 0.04) - bent)
    return heights


def _rings(patch, rng):
    """Return heights (the shape of `patch`) of one or two flat elliptic rings or
    discs.
    """
    heights = np.zeros(patch.shape)
    for _ in range(int(rng.integers(1, 3))):
        along, across = _turned(patch, rng)
        outer = rng.uniform(0.15, 0.3)
        depth = rng.uniform(0.02, 0.3)
        distance = np.hypot(along, across * rng.uniform(1, 1.5))
        inner = outer * rng.choice([0.0, rng.uniform(0.3, 0.7)])
        ring = (distance < outer) & (distance > inner)
        heights = np.where(ring, depth, heights)
    return heights


def _pyramids(patch, rng):
    """Return heights (the shape of `patch`) of a pyramid with a flat top."""
    along, across = _turned(patch, rng)
    distance = np.maximum(np.abs(along), np.abs(across) * rng.uniform(0.7, 1.5))
    return -rng.uniform(0.1, 0.8) * np.maximum(distance - rng.uniform(0.05, 0.3), 0)


def _grooves(patch, rng):
    """Return roughness (the shape of `patch`) with parallel grooves of triangular
    section; lengths are over the period, and `rng` is a numpy generator.
    """
    a, b = rng.choice([[2, 0], [1, 2], [3, 3], [0, 4]])
    x, y = patch.offsets()
    across = np.abs((a * x + b * y + rng.uniform()) % 1 - 0.5)
    width = rng.uniform(0.1, 0.4)
    depth = rng.uniform(0.2, 1) * np.maximum(width - across, 0) / math.hypot(a, b)
    return 0.1 * _waves(patch, rng) - depth


def _spikes(patch, rng):
    """Return roughness (the shape of `patch`) with narrow cones."""
    heights = _waves(patch, rng)
    for _ in range(int(rng.integers(3, 30))):
        along, across = _turned(patch, rng)
        height = rng.uniform(0.02, 0.1)
        slope = rng.uniform(2, 8)
        heights = heights + np.maximum(height - slope * np.hypot(along, across), 0)
    return heights


def _lapped(patch, rng):
    """Return waves (the shape of `patch`) whose heights above a level are scaled down,
    so that they have an edge at the level.
    """
    heights = _waves(patch, rng)
    level = rng.uniform(0, 1.5) * heights.std()
    return np.minimum(heights, level + rng.uniform() * (heights - level))


def _turned(patch, rng):
    """Return distances (nx, ny), over the period, from a random centre along two random
    orthogonal axes.
    """
    x, y = patch.offsets(rng.uniform(size=2))
    turn = rng.uniform(0, np.pi)
    along = x * math.cos(turn) + y * math.sin(turn)
    across = y * math.cos(turn) - x * math.sin(turn)
    return along, across


#: Kinds of surfaces to which constants are fitted, none of `laboratory.areas`.
FITTED_KINDS = {
    "waves": _waves,
    "oblong": _waves,
    **by_name(
        _terraces,
        _ripples,
        _ellipsoids,
        _rings,
        _pyramids,
        _grooves,
        _spikes,
        _lapped,
    ),
}


def _along_the_grid(patch, rng):
    """Return self-affine ridges (the shape of `patch`), five times as long as wide,
    along x or y.
    """
    n = patch.shape[0]
    high = patch.high
    k = np.fft.fftfreq(n, 1 / n)
    across, along = np.meshgrid(k, k, indexing="ij")
    wavenumber = np.hypot(across, along)
    stretched = np.hypot(across, 5 * along)
    amplitude = np.where(wavenumber <= high, (1 + stretched) ** -1.8, 0.0)
    few = np.r_[0 : high + 1, -high:0]  # the same waves on every grid
    normal = rng.normal(size=(2 * high + 1, 2 * high + 1, 2))
    waves = np.zeros((n, n), complex)
    waves[np.ix_(few, few)] = normal @ (1, 1j)
    waves *= amplitude
    heights = np.fft.ifft2(waves).real
    slope = 2 * np.pi * np.abs(waves) * wavenumber / n**2
    heights /= math.sqrt((slope**2).sum() / 2)
    if rng.uniform() < 0.5:
        return heights
    return heights.T


#: What the constants are judged on.
JUDGED_KINDS = {
    **KINDS,
    "along the grid": _along_the_grid,
    "unloaded": partial(roughness, low=0.2, high=0.95),
}


def scene_of(kinds, kind, seed, points, finer):
    """Return a random surface and load of the ensemble as a scene of period 1.

    Args:
        kinds: functions that return heights, by kind.
        kind: key of `kinds`.
        seed: seed of surface and load.
        points: points of the coarse grid a side.
        finer: refinement of the scene's grid.

    Loads are below 0.3 E*.
    """
    drawn = member(kinds, kind, seed, points)
    load = drawn.load if drawn.load < 0.3 else drawn.load / 10
    path = (load,)
    hardness = drawn.hardness
    if kind == "unloaded":
        random = np.random.default_rng([seed, 1])
        path = (load, load * 10 ** random.uniform(-1.5, -0.05))
        hardness = min(hardness, 1.2)
    nx, ny = drawn.shape
    fine = replace(drawn, shape=(finer * nx, finer * ny))
    heights = drawn.maker(fine, np.random.default_rng(drawn.drawn))
    material = Material(1.0, 0.0, hardness)
    return Scene(Surface(heights, drawn.periods), material, Load(path))


def measure_both_grids(kinds, seeds, points, finer):
    """Return (kind, branch, coarse punch, fine punch) of each scene and branch of the
    load path.

    A punch is the flat punch of the scene's contact, whose conductance and stiffness
    are measured. The arguments are those of `scene_of`, with all `seeds`. Scenes
    without contact or nearly without a gap are left out, and so is the loading branch
    of scenes without plastic points, where it equals the unloading branch.
    """
    measured = []
    for kind in kinds:
        for seed in seeds:
            scenes = [scene_of(kinds, kind, seed, points, n) for n in (1, finer)]
            try:
                measured += _punches_by_branch(kind, scenes)
            except EpcontactError as error:
                print(f"{kind} {seed}: {error}", file=sys.stderr)
    return measured


def _punches_by_branch(kind, scenes):
    """Return (kind, branch, coarse punch, fine punch) of the branches of a scene on two
    grids.

    `scenes` holds the scene on the coarse and on the fine grid.
    """
    results = [bem.solve(scene, tolerance=1e-7, threads=1) for scene in scenes]
    measured = []
    for branch in QUANTITIES:
        masks = [carrying_points(result, branch) for result in results]
        if not all(0 < mask.mean() < _FULLEST for mask in masks):
            continue
        solved = zip(scenes, results, masks, strict=True)
        coarse, fine = (measure_punch(*scene_and_mask) for scene_and_mask in solved)
        beside_plastic = coarse.beside_plastic and fine.beside_plastic
        if branch == "unloading" or beside_plastic:
            measured.append((kind, branch, coarse, fine))
    return measured


def relative_errors(measured, constants=None):
    """Return a table with a row for each pair of punches, relative to the limit of the
    finer grid.

    Columns `raw` and `error` are the errors of the raw value and of the extrapolated
    limit, and `estimate` is the estimated error of the limit. `constants` replaces
    those of the extrapolation.
    """
    rows = []
    for kind, branch, coarse, fine in measured:
        limit = stiffness_limit(coarse, constants)
        reference = stiffness_limit(fine, constants).corrected
        row = {
            "kind": kind,
            "quantity": QUANTITIES[branch],
            "raw": abs(math.log(limit.raw / reference)),
            "error": abs(math.log(limit.corrected / reference)),
            "estimate": limit.error / limit.corrected,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def fit(measured, start):
    """Return the constants of the extrapolation with the least loss for measured pairs
    of punches.

    An intensity of 0 in `start` is not fitted.
    """

    def mean_logarithm(centre):
        """Return the mean logarithm of the errors, given the intensity and the setback
        of the extrapolation as `centre`.
        """
        changed = start._replace(intensity=centre[0], setback=centre[1])
        return np.log(relative_errors(measured, changed)["error"] + 0.002).mean()

    def loss(logarithms):
        """Return the mean width of the intervals with a penalty for errors outside,
        given the logarithms of the random error and the area factor.
        """
        random_error, area_factor = np.exp(logarithms)
        changed = start._replace(random_error=random_error, area_factor=area_factor)
        rows = np.log(
            relative_errors(measured, changed)[["estimate", "error"]] + _LEAST
        )
        outside = np.maximum(rows["error"] - rows["estimate"], 0)
        return np.mean(rows["estimate"] + outside / (1 - COVERED))

    if start.intensity:
        centre = minimize(mean_logarithm, start[:2], method="Nelder-Mead").x
        start = start._replace(intensity=centre[0], setback=centre[1])
    at = np.log([start.random_error, start.area_factor])
    for _ in range(2):  # a second simplex leaves where the first one has collapsed
        simplex = np.vstack([at, at + 0.7 * np.eye(at.size)])
        options = {"initial_simplex": simplex, "xatol": 0.02}
        at = minimize(loss, at, method="Nelder-Mead", options=options).x
    random_error, area_factor = np.exp(at).tolist()
    return start._replace(random_error=random_error, area_factor=area_factor)


def _disc(points, radius, centre):
    """Return the scene of a flat disc on a floor; radius and centre are over the
    period, and `points` is the number a side.
    """
    x, y = ((np.arange(points) / points - c + 0.5) % 1 - 0.5 for c in centre)
    heights = np.where(np.hypot(x[:, None], y[None]) < radius, 0.0, -10.0)
    return Scene(Surface(heights, (1.0, 1.0)), Material(1.0, 0.0), Load(0.05))


def step_setbacks(count=24):
    """Return the shift of the contact's edge, in grid spacings, that each of some flat
    discs needs beyond CONSTANTS.setback.

    `count` is the number of discs on each of three grids.
    """
    needed = []
    random = np.random.default_rng(5)
    for points in np.repeat([64, 128, 256], count):
        radius = random.uniform(0.08, 0.2)
        centre = random.uniform(size=2)
        scene = _disc(points, radius, centre)
        fine = _disc(2048, radius, centre)
        exact_sinking = 2 / FLAT_PUNCH.scalar("quantity.conductance", fine)
        result = bem.solve(scene, threads=1)
        punch = measure_punch(scene, result, carrying_points(result, "unloading"))
        change = punch.sinking * math.log(punch.sinking / exact_sinking)
        distance = change / punch.release / CONSTANTS.intensity
        needed.append(distance - punch.offset - CONSTANTS.setback)
    return np.array(needed)


def table(measured):
    """Return medians of errors in % and fractions of errors within their estimates, by
    quantity and kind of surface.
    """
    rows = relative_errors(measured)
    rows["within"] = rows["error"] <= rows["estimate"]
    groups = pd.concat([rows, rows.assign(kind="~ all")]).groupby(["quantity", "kind"])
    medians = 100 * groups[["raw", "error", "estimate"]].median()
    return medians.join(groups["within"].agg(["mean", "size"])).round(2)


#: Ranges of H/(E* xi) and of P/H: heavy load and plastic, elastic, light load and
#: plastic, and between.
RANGES = (
    ((0.03, 0.1), (0.1, 0.3)),
    ((0.5, 1.0), (0.01, 0.15)),
    ((0.03, 0.1), (0.005, 0.05)),
    ((0.15, 0.4), (0.01, 0.3)),
)
#: Scenes by the number of shortest waves on a period.
WAVES = {16: 24, 32: 24, 64: 20, 128: 20}


def waves(finer=4):
    """Return the fraction of errors within the estimate, by the number of shortest
    waves on a period.

    Scenes of half 0 have given the systematic error, and those of half 1 have not. Each
    half is judged without the systematic error and with it. `finer` is the refinement
    of the reference grid.
    """
    rows = []
    for high, count in WAVES.items():
        random = np.random.default_rng([31, high])
        for number in range(count):
            scene = _rough_joint(random, high, number)
            punches = [
                _unloading_punch(scene),
                _unloading_punch(_refined(scene, finer)),
            ]
            for error in (0.0, CONSTANTS.systematic_error):
                constants = CONSTANTS._replace(systematic_error=error)
                row = relative_errors([("", "unloading", *punches)], constants)
                rows.append(row.assign(waves=high, half=number % 2, systematic=error))
    found = pd.concat(rows)
    found["within"] = found["error"] <= found["estimate"]
    groups = found.groupby(["systematic", "half", "waves"])
    return groups["within"].agg(["mean", "size"]).round(2)


def _rough_joint(random, high, number):
    """Return a random rough joint with `high` shortest waves on its period, whose
    parameters are drawn from RANGES.

    `random` is a numpy generator, and `number` the seed of the surface.
    """
    hardnesses, loads = np.log(RANGES[number // 2 % len(RANGES)])
    hardness = math.exp(random.uniform(*hardnesses))
    load = math.exp(random.uniform(*loads))
    load = min(load, 0.4 / math.hypot(1, 2 * hardness))
    breadth = int(random.choice([4, 8]))
    hurst = random.uniform(0.3, 0.9)
    return joint_scene(breadth, hurst, hardness, load, 9000 + number, high // breadth)


def _refined(scene, finer):
    """Return the scene on a grid that is finer by the factor `finer` along each
    axis.
    """
    heights = scene.surface.heights
    for axis in (0, 1):
        heights = resample(heights, finer * heights.shape[axis], axis=axis)
    return replace(scene, surface=Surface(heights, scene.surface.periods))


def _unloading_punch(scene):
    """Solve a scene, and return the measured flat punch on all of its contact."""
    result = bem.solve(scene, tolerance=1e-7, threads=1)
    return measure_punch(scene, result, carrying_points(result, "unloading"))


def main():
    """Print the constants in use, those fitted, and the table of the judged kinds."""
    measured = []
    for seeds, points, finer in FITTED_ON:
        measured += measure_both_grids(FITTED_KINDS, seeds, points, finer)
    for start, branch in ((CONSTANTS, "unloading"), (SMOOTH, "loading")):
        of_branch = [row for row in measured if row[1] == branch]
        print(branch, len(of_branch), "in use", start)
        for part in (of_branch, of_branch[::2], of_branch[1::2]):
            print("  fitted", np.round(fit(part, start), 3))
    needed = step_setbacks()
    scatter = np.quantile(np.abs(needed - np.median(needed)), COVERED)
    print(
        f"steps add {np.median(needed):.3f} to the setback, with an error of "
        f"{scatter * CONSTANTS.intensity:.3f}; in use {STEP_SETBACK} and {STEP_ERROR}"
    )
    judged = []
    for seeds, points, finer in JUDGED_ON:
        judged += measure_both_grids(JUDGED_KINDS, seeds, points, finer)
    print(table(judged).to_string())


if __name__ == "__main__":
    if sys.argv[1:] == ["waves"]:
        print(waves().to_string())
    else:
        main()
