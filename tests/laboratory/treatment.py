"""The effect of the treatment of a measured map's edges on the results.

Maps are cut out of larger periodic ones, and lie tilted.  The unit of length is the
spacing of the grid, E* is 1, the rms slope SLOPE and the hardness HARDNESS: contact
depends on the ratios alone.

`python -m laboratory.treatment [--full]` draws the charts.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from epcontact import bem
from epcontact.alternatives import without_alternatives
from epcontact.errors import NotConverged, SurfaceWarning
from epcontact.harness.quantities.registry import measure
from epcontact.output.charts.plot import Axis, Plot
from epcontact.results import ELASTIC, PLASTIC, ContactResult, FloatArray
from epcontact.scene import Load, Material, Scene, Surface, rms_slope
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    Study,
    list_rows,
    root_mean_square,
    tabulate,
)
from epcontact.studies.paper_scene import self_affine
from epcontact.surfaces import HeightsFromArray
from epcontact.surfaces.power_spectrum import even_moments
from epcontact.surfaces.treatment import remove_form
from laboratory import charts
from laboratory.areas import by_name

SLOPE = 0.05
HARDNESS = 0.2 * SLOPE
#: Mean pressures over the hardness.
LOADS = (0.01, 0.03, 0.1, 0.2, 0.4)
#: Contact states of a grid point that count as each part of the area.
STATES = {
    "total": (ELASTIC, PLASTIC),
    "elastic": (ELASTIC,),
    "plastic": (PLASTIC,),
}
#: Quantities that a table of loads shows, beside areas and the mean gap.
MEASURED = (
    "stiffness loading",
    "conductance",
    "contact percolation",
    "gap percolation",
)
TREATMENTS = ("mirrored", "periodic")


def _rolled_off(
    n: int,
    seed: int,
    longest: float = 24.0,
) -> FloatArray:
    """Return self-affine heights (n, n) of Hurst exponent .8 and rms slope 1.

    The unit of length is the grid spacing.  The shortest waves have 4 points, those of
    the roll-off `longest` points.
    """
    lowest = 2 * math.pi / n
    roll_off = max(n / longest, 1.0)
    return self_affine(
        lowest,
        (n, n),
        seed,
        n / 4,
        roll_off,
    ).heights


def _self_affine(n: int, seed: int) -> FloatArray:
    """Return self-affine heights (n, n) without roll-off.

    The unit of length is the grid spacing; `seed` is that of the random numbers.
    """
    return _rolled_off(n, seed, math.inf)


def _turned(n: int, seed: int) -> FloatArray:
    """Return heights (n, n) of a turned surface: oblique grooves with roughness.

    The unit of length is the grid spacing; `seed` is that of the random numbers.
    """
    grooves = max(n // 20, 2)
    x = np.arange(n) / n
    profile = ((grooves * x[:, None] + x) % 1 - 0.5) ** 2
    profile = profile / rms_slope(profile, (1.0, 1.0))
    return np.asarray(profile + 0.5 * _rolled_off(n, seed))


def _blasted(n: int, seed: int) -> FloatArray:
    """Return heights (n, n) of a blasted surface: round dents with roughness.

    The unit of length is the grid spacing; `seed` is that of the random numbers.
    """
    rng = np.random.default_rng(seed)
    x = np.arange(n)
    dents = np.zeros((n, n))
    for _ in range(n * n // 154):
        centre_x, centre_y = rng.uniform(0, n, 2)
        u = (x - centre_x + n / 2) % n - n / 2
        v = (x - centre_y + n / 2) % n - n / 2
        depth = rng.uniform(5, 14) ** 2 - u[:, None] ** 2 - v**2
        dents -= rng.uniform(0.3, 1) * np.maximum(depth, 0) / 4
    return dents / rms_slope(dents, (1.0, 1.0)) + 0.4 * _rolled_off(n, seed)


def _worn(n: int, seed: int) -> FloatArray:
    """Return heights (n, n) whose summits are worn to plateaus with roughness.

    The unit of length is the grid spacing; `seed` is that of the random numbers.
    """
    rough = _rolled_off(n, seed)
    plateaus = np.minimum(rough, 0.3 * rough.std())
    return np.asarray(plateaus + 0.1 * _rolled_off(n, seed + 77, 12.0))


def _ridged(n: int, seed: int) -> FloatArray:
    """Return heights (n, n) of a positive skewness.

    The unit of length is the grid spacing; `seed` is that of the random numbers.
    """
    rough = _rolled_off(n, seed)
    return np.asarray(np.expm1(0.7 * rough / rough.std()) * rough.std())


KINDS: Any = by_name(_rolled_off, _self_affine, _turned, _blasted, _worn, _ridged)


def _solve(surface: Surface, load: float) -> tuple[Scene, ContactResult]:
    """Solve a surface by boundary elements and return the scene and its result.

    `load` is the mean pressure over the hardness.  No error estimates are needed.
    """
    scene = Scene(surface, Material(1.0, 0.0, HARDNESS), Load(load * HARDNESS))
    scene = without_alternatives(scene)
    return scene, bem.solve(scene, threads=1, area_tolerance=1e-5)


def _measure(surface: Surface, load: float) -> dict[str, float]:
    """Return the mean gap and the quantities MEASURED of a surface, by name.

    `load` is the mean pressure over the hardness.  A quantity is NaN where a linear
    solve does not converge.
    """
    scene, result = _solve(surface, load)
    values = {"mean gap": result.final.quantities["mean_gap"]}
    for name in MEASURED:
        values[name] = math.nan
        with contextlib.suppress(NotConverged):
            quantity = f"quantity.{name.replace(' ', '_')}"
            values[name] = measure(quantity, scene, result)
    return values


def _heights(kind: str, n: int, seed: int) -> FloatArray:
    """Return heights (n, n) of a kind of surface, with the rms slope SLOPE.

    `kind` is a name in KINDS, `n` the number of points along a side, and `seed` that of
    the random numbers.  The unit of length is the grid spacing.
    """
    heights = KINDS[kind](n, seed)
    return np.asarray(heights * (SLOPE / rms_slope(heights, (1.0, 1.0))))


def _treat(heights: FloatArray, treatment: Any) -> tuple[Surface, float]:
    """Return the surface of a map, and its shortest length over the side of the map.

    Args:
        heights: The map, (n, n), whose spacing is 1.
        treatment: "mirrored": mirror images continue the map; "periodic": the map is
            taken as a period.

    Returns:
        The surface, and rms slope over rms curvature over the side.
    """
    surface = HeightsFromArray(heights, heights.shape, treatment, form=1).build()
    moments = even_moments(remove_form(heights, 1), (1.0, 1.0))
    return surface, moments.rms_slope / moments.rms_curvature / len(heights)


def controls(kind: str, points: int, seed: int) -> Rows:
    """Return relative errors of quantities on maps whose continuation is known.

    A whole period that lies tilted is mirrored, and a quarter of a period that consists
    of its mirror images is taken as it is.

    Args:
        kind: Name in KINDS.
        points: Points along a side of the map.
        seed: Seed of the surface.

    Returns:
        Rows with treatment, load (mean pressure over the hardness), length (rms slope
        over rms curvature over the side of the map), quantity and error (relative; NaN
        where the exact value is 0).
    """
    period = _heights(kind, points, seed)
    piece = _heights(kind, 3 * points, seed + 100)[:points, :points]
    index = np.arange(points)
    tilted = period + SLOPE * (index[:, None] - 0.6 * index)
    rows = []
    for treatment, exact_treatment, heights in (
        ("mirrored", "periodic", tilted),
        ("periodic", "mirrored", piece),
    ):
        surface, length = _treat(heights, treatment)
        exact_surface, _ = _treat(heights, exact_treatment)
        for load in LOADS:
            exact = _measure(exact_surface, load)
            for name, value in _measure(surface, load).items():
                error = value / exact[name] - 1 if exact[name] else math.nan
                rows.append(
                    {
                        "treatment": treatment,
                        "load": load,
                        "length": length,
                        "quantity": name,
                        "error": error,
                    }
                )
    return rows


def crops(
    kind: str,
    points: int,
    seed: int,
    tiles: int,
) -> Rows:
    """Return errors of the raw areas of crops of a larger surface, over the total area.

    Each crop is solved under the load that it carries on the larger surface.

    Args:
        kind: Name in KINDS.
        points: Points along a side of a crop.
        seed: Seed of the surface.
        tiles: Crops along a side of the larger surface; one in each row and column is
            solved.

    Returns:
        Rows with the columns of `controls`; the error is over the total area.
    """
    side = points * tiles
    heights = _heights(kind, side, seed)
    surface = Surface(heights, (float(side), float(side)))
    rows = []
    for load in LOADS:
        _, result = _solve(surface, load)
        for tile in range(tiles):
            i = tile * points
            j = (2 * tile + 1) % tiles * points
            crop = np.s_[i : i + points, j : j + points]
            pressure = float(result.fields["pressure"][crop].mean())
            if pressure < 0.3 * load * HARDNESS:
                continue
            state = result.fields["state"][crop]
            exact = {part: np.isin(state, s).mean() for part, s in STATES.items()}
            for treatment in TREATMENTS:
                map_surface, length = _treat(heights[crop], treatment)
                _, of_map = _solve(map_surface, pressure / HARDNESS)
                for part, area in vars(of_map.final.areas["raw"]).items():
                    rows.append(
                        {
                            "treatment": treatment,
                            "load": load,
                            "length": length,
                            "quantity": f"{part} area",
                            "error": (area - exact[part]) / exact["total"],
                        }
                    )
    return rows


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
    periods that are taken as they are.  Loads are fractions of the hardness, which is
    .2 E* xi.  Nine of ten errors are within the number in brackets (of areas, over the
    total one), or the second times rms slope over rms curvature over the map's side.
    """
    axes = {"kind": kinds, "seed": seeds, "points": points}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)
        tables = {
            "crops": tabulate(say, crops, **axes, tiles=[tiles]),
            "controls": tabulate(say, controls, **axes),
        }
    x = Axis("load", "mean pressure / hardness (–)")
    for maps, table in tables.items():
        table["size"] = table["error"].abs()
        table["ratio"] = table["size"] / table["length"]
        for name, errors in table.dropna().groupby("quantity", sort=False):
            groups = errors.groupby("treatment", sort=False)
            bounds = groups[["size", "ratio"]].quantile(0.9).reset_index()
            listed = list_rows(bounds, "{treatment} ({size:.2g}, {ratio:.2g})")
            y = Axis("error", f"rms relative error of {name} (–)")
            means = root_mean_square(errors, "error", ["treatment", "load"])
            plot = Plot(
                x,
                y,
                ("treatment",),
                log="xy",
                ticks=LOADS,
            )
            caption = (
                f"How far is the {name} of {maps} from that of the surface? {listed}."
            )
            yield plot, means, caption


FULL = {"points": (96, 192), "seeds": (2, 3), "tiles": 5}
STUDY = Study("treatment", treatment, FULL)

if __name__ == "__main__":
    charts.save(STUDY)
