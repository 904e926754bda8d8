"""What the treatment of a measured map's edges does to the answers.

Maps are cut out of larger periodic ones, and lie tilted.  The unit of length is the
spacing of the grid, E* is 1, the rms slope SLOPE and the hardness HARDNESS: contact
depends on the ratios alone.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from epcontact import bem
from epcontact.errors import NotConverged, SurfaceWarning
from epcontact.harness.quantities.registry import measure
from epcontact.output.charts.plot import Plot
from epcontact.results import ELASTIC, PLASTIC, ContactResult, FloatArray
from epcontact.scene import Load, Material, Scene, Surface, rms_slope
from epcontact.studies.areas import named
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    listed,
    root_mean_square,
    rows,
    study,
)
from epcontact.studies.paper_scene import self_affine
from epcontact.surfaces import HeightsFromArray
from epcontact.surfaces.power_spectrum import even_moments
from epcontact.surfaces.treatment import remove_form

SLOPE = 0.05
HARDNESS = 0.2 * SLOPE
#: Mean pressures over the hardness.
LOADS = (0.01, 0.03, 0.1, 0.2, 0.4)
STATES = {"total": (ELASTIC, PLASTIC), "elastic": (ELASTIC,), "plastic": (PLASTIC,)}
MEASURED = (
    "stiffness loading",
    "conductance",
    "contact percolation",
    "gap percolation",
)
TREATMENTS = ("mirrored", "periodic")


def _rolled_off(n: int, seed: int, longest: float = 24.0) -> FloatArray:
    """Hurst exponent .8 and rms slope 1, from 4 points a wave to so many."""
    lowest, roll_off = 2 * math.pi / n, max(n / longest, 1.0)
    return self_affine(lowest, (n, n), seed, n / 4, roll_off).heights


def _self_affine(n: int, seed: int) -> FloatArray:
    return _rolled_off(n, seed, math.inf)


def _turned(n: int, seed: int) -> FloatArray:
    marks, x = max(n // 20, 2), np.arange(n) / n
    profile = ((marks * x[:, None] + x) % 1 - 0.5) ** 2
    return np.asarray(
        profile / rms_slope(profile, (1.0, 1.0)) + 0.5 * _rolled_off(n, seed)
    )


def _blasted(n: int, seed: int) -> FloatArray:
    rng, x, dents = np.random.default_rng(seed), np.arange(n), np.zeros((n, n))
    for _ in range(n * n // 154):
        u, v = ((x - c + n / 2) % n - n / 2 for c in rng.uniform(0, n, 2))
        deep = rng.uniform(5, 14) ** 2 - u[:, None] ** 2 - v**2
        dents -= rng.uniform(0.3, 1) * np.maximum(deep, 0) / 4
    return dents / rms_slope(dents, (1.0, 1.0)) + 0.4 * _rolled_off(n, seed)


def _worn(n: int, seed: int) -> FloatArray:
    rough = _rolled_off(n, seed)
    return np.asarray(
        np.minimum(rough, 0.3 * rough.std()) + 0.1 * _rolled_off(n, seed + 77, 12.0)
    )


def _ridged(n: int, seed: int) -> FloatArray:
    rough = _rolled_off(n, seed)
    return np.asarray(np.expm1(0.7 * rough / rough.std()) * rough.std())


KINDS: Any = named(_rolled_off, _self_affine, _turned, _blasted, _worn, _ridged)


def _solved(surface: Surface, load: float) -> tuple[Scene, ContactResult]:
    scene = Scene(surface, Material(1.0, 0.0, HARDNESS), Load(load * HARDNESS))
    return scene, bem.solve(scene, threads=1, area_tolerance=1e-5)


def _answers(surface: Surface, load: float) -> dict[str, float]:
    """All that a table of loads shows but areas; nan where a linear solve stalls."""
    scene, result = _solved(surface, load)
    found = {"mean gap": result.final.quantities["mean_gap"]} | dict.fromkeys(
        MEASURED, math.nan
    )
    for name in MEASURED:
        with contextlib.suppress(NotConverged):
            found[name] = measure(f"quantity.{name.replace(' ', '_')}", scene, result)
    return found


def _scaled(kind: str, n: int, seed: int) -> FloatArray:
    heights = KINDS[kind](n, seed)
    return np.asarray(heights * (SLOPE / rms_slope(heights, (1.0, 1.0))))


def _treated(heights: FloatArray, treatment: Any) -> tuple[Surface, float]:
    """A surface from a map whose spacing is 1; its rms slope over rms curvature, over
    its side.
    """
    surface = HeightsFromArray(heights, heights.shape, treatment, form=1).build()
    moments = even_moments(remove_form(heights, 1), (1.0, 1.0))
    return surface, moments.rms_slope / moments.rms_curvature / len(heights)


def controls(kind: str, points: int, seed: int) -> Rows:
    """Relative errors of answers on maps whose continuation is known: mirrored, of a
    whole period that lies tilted, and taken as it is, of a quarter of a period that is
    its mirror images.
    """
    n, found = points, []
    whole, part = _scaled(kind, n, seed), _scaled(kind, 3 * n, seed + 100)[:n, :n]
    tilted = whole + SLOPE * (np.arange(n)[:, None] - 0.6 * np.arange(n))
    for treatment, other, heights in zip(
        TREATMENTS, TREATMENTS[::-1], (tilted, part), strict=True
    ):
        (surface, length), (exact, _) = (
            _treated(heights, way) for way in (treatment, other)
        )
        for load in LOADS:
            row = {"treatment": treatment, "load": load, "length": length}
            truth = _answers(exact, load)
            for name, value in _answers(surface, load).items():
                error = value / truth[name] - 1 if truth[name] else math.nan
                found.append(row | {"quantity": name, "error": error})
    return found


def crops(kind: str, points: int, seed: int, tiles: int) -> Rows:
    """Errors of raw areas, over the total, of crops under the load that each carries
    there.
    """
    n, found = points, []
    whole = _scaled(kind, n * tiles, seed)
    for load in LOADS:
        fields = _solved(Surface(whole, (float(n * tiles),) * 2), load)[1].fields
        for corner in range(tiles):  # one in each row and column
            there = tuple(
                slice(i * n, i * n + n) for i in (corner, (2 * corner + 1) % tiles)
            )
            state, carried = (
                fields["state"][there],
                float(fields["pressure"][there].mean()),
            )
            if carried < 0.3 * load * HARDNESS:
                continue
            truth = {part: np.isin(state, of).mean() for part, of in STATES.items()}
            for treatment in TREATMENTS:
                surface, length = _treated(whole[there], treatment)
                row = {"treatment": treatment, "load": load, "length": length}
                last = _solved(surface, carried / HARDNESS)[1].final
                for part, area in vars(last.areas["raw"]).items():
                    error = (area - truth[part]) / truth["total"]
                    found.append(row | {"quantity": f"{part} area", "error": error})
    return found


@study("treatment", points=(96, 192), seeds=(2, 3), tiles=5)
def treatment(
    say: Say,
    points: Ints = (48,),
    seeds: Ints = (2,),
    tiles: int = 3,
    kinds: Sequence[str] = tuple(KINDS),
) -> Charts:
    """What mirroring a map, or taking it as it is, does to the answers.

    Crops of larger surfaces are solved under the load that each carries there, and
    compared with their part of the contact.  Controls are maps whose continuation is
    known: whole periods that were tilted and are mirrored, and quarters of mirrored
    periods that are taken as they are. Loads are shares of the hardness, which is .2 E*
    xi.  Nine of ten errors are within the number in brackets (of areas, over the total
    one), or the second times rms slope over rms curvature over the map's side.
    """
    axes = {"kind": kinds, "seed": seeds, "points": points}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)
        found = {
            "Crops": rows(say, crops, **axes, tiles=[tiles]),
            "Controls": rows(say, controls, **axes),
        }
    x = ("load", "mean pressure / hardness (–)")
    for title, table in found.items():
        table["size"] = table["error"].abs()
        table["ratio"] = table["size"] / table["length"]
        for name, one in table.dropna().groupby("quantity", sort=False):
            told = one.groupby("treatment", sort=False)[["size", "ratio"]].quantile(0.9)
            claims = listed(told.reset_index(), "{treatment} ({size:.2g}, {ratio:.2g})")
            y = ("error", f"rms relative error of {name} (–)")
            means = root_mean_square(one, "error", ["treatment", "load"])
            plot = Plot(x, y, ("treatment",), log="xy", ticks=LOADS)
            yield plot, means, f"{title}: {name}, {claims}"
