"""The map of the effective hardness: measured areas of J2 bodies, and the caps that give them.

One load path of a J2 body passes every load of the map, and boundary elements capped at a ladder
of hardnesses answer each of these loads on the same elements' compliance.  The effective hardness
of an ensemble is the cap under which the mean area of the capped bodies is that of the J2 bodies.
By similarity it depends on E* xi/sigma_Y, Poisson's ratio, p0/sigma_Y and the shape of the
spectrum alone; the last is varied here, to show how little or much it matters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import pandas as pd

import fem_check
from epcontact.harness.model_difference import capped_body, elements_compliance
from epcontact.harness.statistics import standard_deviation
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.study import Plot, draw_table
from epcontact.reference.hardness_map import (
    FULL,
    PARTS,
    SYMBOLS,
    fitted_ratio,
    formula_text,
    hardness_map,
)
from epcontact.results import FloatArray
from epcontact.scene import Body, Load, Scene
from epcontact.studies.hardness import PERIOD, TABOR, WAVES, model_scene
from epcontact.studies.tables import Progress, Size

#: Mean pressures of a path over the yield stress.
LOADS = (0.1, 0.25, 0.5, 1.0, 1.5, 2.0)
#: Caps over the yield stress that are tried, besides none.
LADDER = tuple(1.08**k for k in range(21))
#: Residuals of the elements: at 1e-4 the contact is that at 1e-8, in half the time.
TOLERANCE = 1e-4


@dataclass(frozen=True)
class Point:
    """One load path: a surface and the material under it.

    severity: E* xi/sigma_Y.  nu: Poisson's ratio.  seed: of the surface.  nodes: a side.  waves:
    shortest waves in a period.  hurst: the Hurst exponent.  depth: of the bonded layer over the
    period.  step_tolerance: of the J2 path.  largest: last of its LOADS.
    """

    severity: float
    nu: float
    seed: int
    nodes: int = 24
    waves: int = WAVES
    hurst: float = 0.8
    depth: float = 1.0
    step_tolerance: float = 0.03
    largest: float = LOADS[-1]

    @property
    def loads(self) -> tuple[float, ...]:
        """The loads of the path, over the yield stress."""
        return tuple(load for load in LOADS if load <= self.largest)

    @property
    def scene(self) -> Scene:
        """The scene, pressed along the loads."""
        scene = model_scene(self.severity, self.nu, self.seed, self.nodes, self.waves, self.hurst)
        sigma_Y = scene.material.yield_stress
        path = Load(tuple(load * sigma_Y for load in self.loads))
        return replace(scene, load=path, body=Body("bonded_layer", self.depth * PERIOD))


#: The fields of Point that the places of the map share.
USUAL = {"nodes": 24, "waves": WAVES, "hurst": 0.8, "depth": 1.0, "step_tolerance": 0.03}


def measured_areas(points: Iterable[Point], progress: Progress) -> pd.DataFrame:
    """Measure the raw areas of J2 bodies and of capped bodies on the same compliance.

    Returns:
        One row for each point, load and cap: the fields of Point, load (p0/sigma_Y), j2_area, cap
        (hardness/sigma_Y, infinite for none) and cap_area.
    """
    tables = []
    for point in points:
        progress(f"hardness map: {point}")
        scene = point.scene
        j2 = fem_check.solve(
            scene,
            law="j2",
            certified=False,
            tolerance=TOLERANCE,
            step_tolerance=point.step_tolerance,
        )
        compliance = elements_compliance(scene, j2)
        for load, step in zip(point.loads, j2.steps, strict=True):
            area = step.areas["raw"].total
            caps = _caps_around(load, area)
            single = replace(scene, load=Load(step.mean_pressure))
            areas = [
                capped_body(single, cap * scene.material.yield_stress, compliance)
                .final.areas["raw"]
                .total
                for cap in caps
            ]
            columns = {"load": load, "j2_area": area, "cap": caps, "cap_area": areas}
            tables.append(pd.DataFrame(asdict(point) | columns))
    return pd.concat(tables, ignore_index=True)


def _caps_around(load: float, area: float) -> list[float]:
    """The caps of LADDER that may carry the load on the area, and none; all over sigma_Y.

    No capped body presses with more than its cap, so that the cap is at least load/area.
    """
    low, high = max(load, 0.9 * load / area), 2.4 * load / area
    return [*(cap for cap in LADDER if low < cap <= high), math.inf]


def inverse_hardness(areas: pd.DataFrame) -> pd.DataFrame:
    """Find sigma_Y/hardness at which an ensemble under a cap has the area of its J2 bodies.

    The inverse is used because the area of a capped body is nearly linear in it, and because it is
    zero, not infinite, where the elastic bodies have that area already.

    Args:
        areas: from `measured_areas`.

    Returns:
        One row for each load of each kind of point (its fields but seed and largest): those
        columns, load, surfaces, area (of the J2 bodies), inverse, and deviation, the standard
        deviation of the inverse of one surface by the jackknife; NaN if there is only one.
    """
    kind = [name for name in Point.__dataclass_fields__ if name not in ("seed", "largest")]
    rows = []
    for key, group in areas.groupby([*kind, "load"], sort=False):
        bodies = [_body(surface, key[-1]) for _, surface in group.groupby("seed")]
        n, nodes = len(bodies), int(group["nodes"].iloc[0])
        whole = _inverse(bodies, nodes)
        left_out = [_inverse(bodies[:k] + bodies[k + 1 :], nodes) for k in range(n) if n > 1]
        # The pseudo-values of Tukey scatter as the surfaces do.
        pseudo = [n * whole - (n - 1) * one for one in left_out]
        deviation = standard_deviation(pseudo) if pseudo else math.nan
        rows.append((*key, n, float(np.mean([body[0] for body in bodies])), whole, deviation))
    return pd.DataFrame(rows, columns=[*kind, "load", "surfaces", "area", "inverse", "deviation"])


#: A surface: the area of the J2 body, the inverse caps over sigma_Y, rising, and their areas.
_Body = tuple[float, Sequence[float], Sequence[float]]


def _body(surface: pd.DataFrame, load: float) -> _Body:
    ordered = surface.sort_values("cap", ascending=False)
    # A cap as large as the load needs the whole area.
    inverse = [*(1 / ordered["cap"]), 1 / load]
    return float(ordered["j2_area"].iloc[0]), inverse, [*ordered["cap_area"], 1.0]


def _inverse(bodies: Sequence[_Body], nodes: int) -> float:
    knots = np.unique(np.concatenate([inverse for _, inverse, _ in bodies]))
    capped = np.mean([np.interp(knots, inverse, areas) for _, inverse, areas in bodies], axis=0)
    wanted = float(np.mean([j2 for j2, _, _ in bodies]))
    # The mean area moves by whole nodes of single surfaces: both edges of a step are averaged.
    half = 0.5 / (nodes**2 * len(bodies))
    edges = np.interp([wanted - half, wanted + half], np.maximum.accumulate(capped), knots)
    return float(edges.mean())


def changes(areas: pd.DataFrame, *, paired: bool = True, **varied: float) -> pd.DataFrame:
    """Compare the inverse hardness of varied points with that of the map's own kind of points.

    Args:
        areas: from `measured_areas`.
        paired: whether only surfaces that both have are compared; else all.
        varied: fields of Point that differ, such as nodes=48.

    Returns:
        One row for each severity, nu and load that both have: these columns, surfaces (the fewer),
        and change, the relative one.
    """
    usual, other = _of_kind(areas, USUAL), _of_kind(areas, USUAL | varied)
    place = ["severity", "nu", "load"]
    keys = [*place, "seed"] if paired else place
    common = usual[keys].drop_duplicates().merge(other[keys].drop_duplicates())
    both = inverse_hardness(usual.merge(common)).merge(
        inverse_hardness(other.merge(common)), on=place, suffixes=("_usual", "")
    )
    fewer = np.minimum(both["surfaces"], both["surfaces_usual"])
    change = both["inverse"] / both["inverse_usual"] - 1
    return both.assign(surfaces=fewer, change=change)[[*place, "surfaces", "change"]]


def _of_kind(areas: pd.DataFrame, kind: Mapping[str, float]) -> pd.DataFrame:
    return areas[np.logical_and.reduce([areas[name] == value for name, value in kind.items()])]


def mapped(areas: pd.DataFrame) -> pd.DataFrame:
    """Make the map from the areas of its points.

    The grid: what is left on 48 nodes is the change from 24 to 48 once more if the error is of
    first order in the spacing, and less if it is of a higher one, so that half of it is taken off
    and half is the error, with the scatter of the changes about their fit in ln(severity) and load.
    The surfaces are few, so that their scatter is pooled over all places of a load.

    Args:
        areas: from `measured_areas`.

    Returns:
        The columns of `reference/hardness_map.csv`.
    """
    table = inverse_hardness(_of_kind(areas, USUAL))
    several = table[table["surfaces"] > 1]
    freedom = several["surfaces"] - 1
    square = freedom * (several["deviation"] / several["inverse"]) ** 2
    by_load = several["load"]
    scatter = np.sqrt(square.groupby(by_load).sum() / freedom.groupby(by_load).sum())
    grid, doubt = _fitted_change(changes(areas, nodes=2 * USUAL["nodes"]), table)
    spectra = [
        changes(areas, paired=False, **varied)["change"]
        for varied in ({"hurst": 0.4}, {"waves": 2, "nodes": 12}, {"waves": 8, "nodes": 48})
    ]
    return pd.DataFrame(
        {
            "severity": table["severity"],
            "poisson_ratio": table["nu"],
            "load": table["load"],
            "surfaces": table["surfaces"],
            "area": table["area"],
            "inverse_hardness": table["inverse"] * (1 + 1.5 * grid),
            "statistical_error": 2 * table["load"].map(scatter) / np.sqrt(table["surfaces"]),
            "grid_error": np.hypot(grid / 2, doubt),
            "spectrum_error": float(np.sqrt(np.mean(np.concatenate(spectra) ** 2))),
        }
    ).sort_values(["poisson_ratio", "severity", "load"])


def _fitted_change(change: pd.DataFrame, table: pd.DataFrame) -> tuple[FloatArray, float]:
    """The change by a linear fit at the places of the table, and the scatter about the fit."""

    def terms(places: pd.DataFrame) -> FloatArray:
        return np.column_stack([np.ones(len(places)), np.log(places["severity"]), places["load"]])

    weight = np.sqrt(change["surfaces"].to_numpy())
    known = change["change"].to_numpy()
    found, *_ = np.linalg.lstsq(terms(change) * weight[:, None], known * weight, rcond=None)
    scatter = np.average((terms(change) @ found - known) ** 2, weights=weight**2)
    return terms(table) @ found, math.sqrt(scatter)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Draw the kept map, one chart for each Poisson's ratio; "full" adds another surface to it."""
    fresh = pd.DataFrame()
    if size == "full":
        points = [Point(severity, 0.3, seed=1) for severity in (5.0, 15.0, 50.0)]
        fresh = inverse_hardness(measured_areas(points, progress))
    known = pd.DataFrame(dict(hardness_map()))
    return tuple(
        draw_map(part, fresh[fresh["nu"] == nu] if len(fresh) else fresh)
        for nu, part in known.groupby("poisson_ratio")
    )


def draw_map(known: pd.DataFrame, fresh: pd.DataFrame) -> Chart:
    """Draw the map at one Poisson's ratio, the formula, and points measured on another surface."""
    nu = float(known["poisson_ratio"].iloc[0])
    known = known[(known["area"] <= FULL) & (known["inverse_hardness"] > 0)]
    error = np.sqrt(sum(known[part] ** 2 for part in PARTS))
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
    if len(fresh):
        tables.append(
            pd.DataFrame(
                {
                    "colour": fresh["severity"],
                    "load": fresh["load"],
                    "effective_hardness": 1 / fresh["inverse"],
                    "series": fresh["severity"].map("{:g}, surface of seed 1".format),
                    "style": "open",
                }
            )
        )
    return draw_table(
        pd.concat(tables),
        Plot(
            ("load", "p0 / sigma_Y (–)"),
            ("effective_hardness", "effective hardness c = hardness / sigma_Y (–)"),
            colour="colour",
            log="x",
            ticks=LOADS,
            level=TABOR,
        ),
        f"The effective hardness of rough J2 metals of Poisson's ratio {nu:g}: the cap, in yield "
        "stresses, under which capped boundary elements carry the load on the J2 body's area. "
        f"Bars: 95 % intervals. Curves: {formula_text()}. Dotted: 3, Tabor's rule. Places of a "
        f"contact area above {FULL:g} are left out.",
    )
