"""What the treatment of a measured map's edges does to the answers.

Maps are cut out of larger periodic ones, and lie tilted.  The unit of length is the spacing of the
grid, E* is 1, the rms slope SLOPE and the hardness HARDNESS: contact depends on the ratios alone.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import numpy as np
import pandas as pd
from scipy.signal.windows import tukey

from epcontact import bem
from epcontact.errors import NotConverged, SurfaceWarning
from epcontact.harness.quantities.registry import measure
from epcontact.output.charts.plot import Plot
from epcontact.results import ELASTIC, PLASTIC, ContactResult, FloatArray
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface, rms_slope
from epcontact.studies.areas import named
from epcontact.studies.frame import Charts, Ints, Say, study
from epcontact.surfaces import HeightsFromArray, SelfAffine, Treatment
from epcontact.surfaces.power_spectrum import even_moments
from epcontact.surfaces.treatment import form_removed

SLOPE = 0.05
HARDNESS = 0.2 * SLOPE
#: Mean pressures over the hardness.
LOADS = (0.01, 0.03, 0.1, 0.2, 0.4)
STATES = {"total": (ELASTIC, PLASTIC), "elastic": (ELASTIC,), "plastic": (PLASTIC,)}
MEASURED = ("stiffness_loading", "conductance", "gap_percolation")


def _rolled_off(n: int, seed: int, longest: float = 24.0) -> FloatArray:
    """Hurst exponent .8 and rms slope 1, from 4 points a wave to so many."""
    low, high = 2 * math.pi / n, 2 * math.pi / 4
    spectrum = SelfAffineSpectrum(0.8, low, max(2 * math.pi / longest, low), high, 1.0)
    return SelfAffine(spectrum, (float(n),) * 2, (n, n), seed).build().heights


def _self_affine(n: int, seed: int) -> FloatArray:
    return _rolled_off(n, seed, math.inf)


def _turned(n: int, seed: int) -> FloatArray:
    marks, x = max(n // 20, 2), np.arange(n) / n
    profile = ((marks * x[:, None] + x) % 1 - 0.5) ** 2
    return np.asarray(profile / rms_slope(profile, (1.0, 1.0)) + 0.5 * _rolled_off(n, seed))


def _blasted(n: int, seed: int) -> FloatArray:
    rng, x, dents = np.random.default_rng(seed), np.arange(n), np.zeros((n, n))
    for _ in range(n * n // 154):
        u, v = ((x - c + n / 2) % n - n / 2 for c in rng.uniform(0, n, 2))
        deep = rng.uniform(5, 14) ** 2 - u[:, None] ** 2 - v**2
        dents -= rng.uniform(0.3, 1) * np.maximum(deep, 0) / 4
    return dents / rms_slope(dents, (1.0, 1.0)) + 0.4 * _rolled_off(n, seed)


def _worn(n: int, seed: int) -> FloatArray:
    rough = _rolled_off(n, seed)
    return np.asarray(np.minimum(rough, 0.3 * rough.std()) + 0.1 * _rolled_off(n, seed + 77, 12.0))


def _ridged(n: int, seed: int) -> FloatArray:
    rough = _rolled_off(n, seed)
    return np.asarray(np.expm1(0.7 * rough / rough.std()) * rough.std())


KINDS: Any = named(_rolled_off, _self_affine, _turned, _blasted, _worn, _ridged)


def _windowed(heights: FloatArray) -> FloatArray:
    """Tapered to zero over a tenth at each edge, and scaled to the rms slope it had."""
    windows = np.ix_(*(tukey(2 * n + 1, 0.2)[1::2] for n in heights.shape))
    left = math.prod(windows, start=heights)
    return np.asarray(left * (rms_slope(heights, (1.0, 1.0)) / rms_slope(left, (1.0, 1.0))))


def _faded(heights: FloatArray) -> FloatArray:
    """Over a tenth at each edge faded into what is as far from the other edge."""
    for axis in (0, 1):
        n = heights.shape[axis]
        away = np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.1 * n)
        share = (1 + np.cos(np.pi * np.minimum(away, 1))) / 4
        share = np.expand_dims(share, 1 - axis)
        heights = (1 - share) * heights + share * np.flip(heights, axis)
    return heights


#: Of the treatments, the first two are those of `epcontact.surfaces`.
TREATMENTS = {"mirrored": None, "periodic": None} | named(_windowed, _faded)


def treated(heights: FloatArray, treatment: str) -> Surface:
    """A surface from a map with tilt, whose spacing is 1."""
    periods = tuple(map(float, heights.shape))
    change: Any = TREATMENTS[treatment]
    if change is None:
        return HeightsFromArray(heights, periods, cast(Treatment, treatment), form=1).build()
    return Surface(change(form_removed(heights, 1)), periods)


def _solved(surface: Surface, load: float) -> tuple[Scene, ContactResult]:
    scene = Scene(surface, Material(1.0, 0.0, HARDNESS), Load(load * HARDNESS))
    return scene, bem.solve(scene, threads=1, area_tolerance=1e-5)


def _answers(surface: Surface, load: float) -> dict[str, float]:
    """Areas and all else of a surface; nan where a linear solve stalls."""
    scene, result = _solved(surface, load)
    found = {f"{part} area": v for part, v in vars(result.final.areas["corrected"]).items()}
    found["mean gap"] = result.final.quantities["mean_gap"]
    for name in MEASURED:
        try:
            found[name.replace("_", " ")] = measure(f"quantity.{name}", scene, result)
        except NotConverged:
            found[name.replace("_", " ")] = math.nan
    return found


def _scaled(kind: str, n: int, seed: int) -> FloatArray:
    heights = KINDS[kind](n, seed)
    return np.asarray(heights * (SLOPE / rms_slope(heights, (1.0, 1.0))))


def controls(kind: str, n: int, seed: int) -> list[dict[str, Any]]:
    """Relative errors of all answers on a map that is one whole period, but tilted."""
    whole, rows = _scaled(kind, n, seed), []
    tilted = whole + SLOPE * (np.arange(n)[:, None] - 0.6 * np.arange(n))
    surfaces = {treatment: treated(tilted, treatment) for treatment in TREATMENTS}
    for load in LOADS:
        truth = _answers(Surface(whole, (float(n),) * 2), load)
        for treatment, surface in surfaces.items():
            for name, value in _answers(surface, load).items():
                row = {"quantity": name, "treatment": treatment, "load": load}
                rows.append(row | {"error": value / truth[name] - 1 if truth[name] else math.nan})
    return [{"kind": kind} | row for row in rows]


def crops(kind: str, n: int, seed: int, tiles: int) -> list[dict[str, Any]]:
    """Errors of raw areas, over the total, of crops under the load that each carries there."""
    whole, rows = _scaled(kind, n * tiles, seed), []
    for load in LOADS:
        fields = _solved(Surface(whole, (float(n * tiles),) * 2), load)[1].fields
        for corner in range(tiles):  # one in each row and column
            there = tuple(slice(i * n, i * n + n) for i in (corner, (2 * corner + 1) % tiles))
            state, carried = fields["state"][there], float(fields["pressure"][there].mean())
            if carried < 0.3 * load * HARDNESS:
                continue
            truth = {part: np.isin(state, of).mean() for part, of in STATES.items()}
            moments = even_moments(form_removed(whole[there], 1), (1.0, 1.0))
            about = {"load": load, "length": moments.rms_slope / moments.rms_curvature / n}
            for treatment in TREATMENTS:
                last = _solved(treated(whole[there], treatment), carried / HARDNESS)[1].final
                for part, area in vars(last.areas["raw"]).items():
                    row = {"part": part, "treatment": treatment} | about
                    rows.append(row | {"error": (area - truth[part]) / truth["total"]})
    return [{"kind": kind, "points": n, "seed": seed} | row for row in rows]


@study("treatment", points=(96, 192), seeds=(2, 3), tiles=5)
def treatment(
    say: Say, points: Ints = (48,), seeds: Ints = (2,), tiles: int = 3,
    kinds: Sequence[str] = tuple(KINDS),
) -> Charts:  # fmt: skip
    """What mirroring a map, taking it as it is, tapering or fading its edges does to the answers.

    Crops of larger surfaces are solved under the load that each carries there, and compared with
    their part of the contact.  Controls are whole periods that were tilted.  Loads are shares of
    the hardness, which is .2 E* xi.  In brackets, as a share of the total area: nine of ten errors
    of the worst part of it are within this times rms slope over rms curvature over the map's side.
    """
    found, whole = list[dict[str, Any]](), list[dict[str, Any]]()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)
        for kind in kinds:
            for seed in seeds:
                say(f"{kind}, seed {seed}")
                found += [row for n in points for row in crops(kind, n, seed, tiles)]
                whole += controls(kind, points[0], seed)
    x, root = ("load", "mean pressure / hardness (–)"), lambda errors: math.sqrt((errors**2).mean())
    plot = partial(Plot, x, series=("treatment",), log="xy", ticks=LOADS)
    table = pd.DataFrame(found)
    ratio = table.assign(ratio=table["error"].abs() / table["length"])
    parts = ratio.groupby(["treatment", "part"], sort=False)["ratio"].quantile(0.9)
    worst = parts.groupby("treatment", sort=False).max()
    told = ", ".join(f"{name} ({value:.2g})" for name, value in worst.items())
    by_load = table[table["part"] == "total"].groupby(["treatment", "load"], sort=False)["error"]
    y = ("error", "rms error of the contact area (–)")
    yield plot(y), by_load.agg(root).reset_index(), f"Contact area of crops: {told}"
    table = pd.DataFrame(whole)
    for name, one in table.groupby("quantity", sort=False):
        rms = one.groupby(["treatment", "load"], sort=False)["error"].agg(root).reset_index()
        y = ("error", f"rms relative error of {name} (–)")
        yield plot(y), rms, f"Controls: {name} of whole periods that were tilted"
