"""The study of stability: the parameters at which each method converges, with its failures.

capped   boundary elements, p0/hardness against hardness/(E* xi): the Newton solver, each baseline
elastic  the same for an infinite hardness, against p0/(E* xi) alone
theory   p0/hardness against G/hardness^2: the eigenfunctions, the images, and what the package
         makes of them; effort is the number of terms, residual the relative error of the areas
fem      p0/(E* xi) against E* xi/yield_stress: J2 half-blocks, one panel a Poisson's ratio

A point counts as converged only if the answer also passes a check that is independent of the
method: the contact conditions measured on the pressure field by other transforms (capped,
elastic), the conservation of force and the particle-hole symmetry of the areas (theory), the
balance as scikit-fem's assembly finds it (fem).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import fem_check
from epcontact import bem, persson
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.files import write_json
from epcontact.harness.quantities.registry import measure
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.maps import stability_map as draw_map
from epcontact.results import ContactResult, package_versions
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.studies.frame import Say, rows
from epcontact.surfaces import SelfAffine

#: Largest allowed violation of the contact conditions, measured by the harness, of a solve that
#: claims 1e-8, and relative error of an area up to which a sum of the theory has converged.
EXAMINED, AREA_ERROR = 1e-6, 1e-9
_TERMS = 200
#: A division by zero counts as a failure like a report that the solver did not converge.
_FAILURES = (EpcontactError, ArithmeticError, np.linalg.LinAlgError)

#: The axes of the maps, grid points and step limits of the sweeps by size.
SIZES: dict[str, dict[str, Any]] = {
    "coarse": {
        "points": 32,
        "load_shares": (0.001, 0.1, 0.5, 0.99),
        "hardnesses": (0.001, 0.1, 1.0, 100.0),
        "loads": (0.001, 0.1, 1.0, 3.0),
        "diffusions": (1e-4, 1e-2, 0.2, 1.0, 10.0),
        "baseline_steps": 500,
        "fem_points": (32,),
        "poisson_ratios": (0.0, 0.3, 0.499),
        "fem_loads": (0.01, 0.2),
        "yield_ratios": (0.5, 5.0, 50.0),
    },
    "full": {
        "points": 128,
        "load_shares": (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97, 0.99),
        "hardnesses": (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0),
        "loads": (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0),
        "diffusions": tuple(np.geomspace(1e-6, 1e2, 17).tolist()),
        "baseline_steps": 1000,
        "fem_points": (24, 24),
        "poisson_ratios": (0.0, 0.2, 0.3, 0.4, 0.49, 0.499),
        "fem_loads": (0.003, 0.01, 0.05, 0.2, 1.0),
        "yield_ratios": (0.5, 2.0, 5.0, 15.0, 50.0),
    },
}


def stability(
    maps: Sequence[str] = (),
    size: str = "coarse",
    *,
    methods: Sequence[str] = bem.METHODS,
    say: Say = lambda _: None,
) -> pd.DataFrame:
    """Sweep the named maps (none: all) at a size: coarse (seconds) or full (minutes).

    `methods` are those of the boundary elements.  Returns a row for each solve: map, method, x, y
    (the groups of the map's axes), converged, effort (transform pairs, terms or Newton steps),
    residual (dimensionless, of the examination) and the reason of a failure.  Raises InvalidCase
    for a map or size that is not known.
    """
    if unknown := [name for name in maps if name not in MAPS]:
        raise InvalidCase(f"no stability map is called {unknown[0]!r}; there are {', '.join(MAPS)}")
    if size not in SIZES:
        raise InvalidCase(f"size is {size!r}, but must be {' or '.join(SIZES)}")
    tables = []
    for name in maps or MAPS:
        row, axes, _ = MAPS[name](SIZES[size], methods)
        tables.append(rows(partial(_told, say, name), row, **axes))
        tables[-1].insert(0, "map", name)
    return pd.concat(tables, ignore_index=True)


def _told(say: Say, name: str, what: str) -> None:
    say(f"{name}: {what}")


def _solved(
    solve: Callable[[], ContactResult], effort: str, examine: Callable[[ContactResult], float]
) -> dict[str, Any]:
    """Whether a solve converges and passes the examination, at which effort."""
    try:
        result = solve()
    except _FAILURES as error:
        residual = float(max(getattr(error, "residuals", {}).values(), default=math.nan))
        kind = "" if isinstance(error, EpcontactError) else f"{type(error).__name__}: "
        return _row(math.nan, residual, f"{kind}{error}")
    residual = examine(result)
    reason = f"claims to have converged, but violates a condition by {residual:.1e}"
    return _row(float(result.cost[effort]), residual, "" if residual <= EXAMINED else reason)


def _row(effort: float, residual: float, reason: str) -> dict[str, Any]:
    return {"converged": not reason, "effort": effort, "residual": residual, "reason": reason}


# --- boundary elements ---------------------------------------------------------------------------


def rough_surface(shape: tuple[int, ...]) -> Surface:
    """Self-affine roughness of slope 0.1 with at least four points per shortest wave."""
    period, waves = 1e-3, max(4, min(shape) // 4)
    q0 = 2 * math.pi / period
    spectrum = SelfAffineSpectrum(0.8, q0, 2 * q0, waves * q0, 0.1)
    return SelfAffine(spectrum, (period,) * len(shape), shape, seed=1).build()


def _boundary_elements(grid: Mapping[str, Any], methods: Sequence[str], *, capped: bool) -> Any:
    surface = rough_surface((grid["points"],) * 2)
    unit = 1e11 * 0.1  # E* xi in Pa, Poisson's ratio being zero

    def row(method: str, x: float, y: float) -> dict[str, Any]:
        hardness = y * unit
        scene = Scene(
            surface, Material(1e11, 0.0, hardness), Load(x * (hardness if capped else unit))
        )
        options = {"max_steps": None if method == "newton" else grid["baseline_steps"]}
        names = [f"quantity.measured_{name}" for name in ("gap", "force", "bounds")]
        return _solved(
            lambda: bem.solve(scene, method=method, threads=1, **options),  # type: ignore[arg-type]
            "equivalent_fft_pairs",
            lambda result: max(abs(measure(name, scene, result)) for name in names),
        )

    x, y = ("load_shares", grid["hardnesses"]) if capped else ("loads", (math.inf,))
    labels = ("p0 / hardness (–)" if capped else "p0 / (E* xi) (–)", "hardness / (E* xi) (–)")
    return row, {"method": methods, "x": grid[x], "y": y}, (*labels, "transform pairs")


# --- theory --------------------------------------------------------------------------------------


def _theory(grid: Mapping[str, Any], methods: Sequence[str]) -> Any:
    del methods  # those of the boundary elements
    axes = {"method": ("eigenfunctions", "images", "package"), "x": grid["load_shares"]}
    labels = ("p0 / hardness (–)", "G / hardness^2 (–)", "terms")
    return _sum, axes | {"y": grid["diffusions"]}, labels


def _sum(method: str, x: float, y: float) -> dict[str, Any]:
    """How far the areas by a method are off; the package's own are judged by their symmetry."""
    exact, terms = _package_areas(x, y), 1
    if method == "package":
        mirrored = _package_areas(1 - x, y)
        error = max(
            abs(sum(exact) - 1), _relative(exact[1], mirrored[2]), _relative(exact[0], mirrored[0])
        )
    else:
        terms, areas = (_eigenfunctions if method == "eigenfunctions" else _images)(x, y)
        error = max(_relative(a, b) for a, b in zip(areas, exact, strict=True))
    reason = f"an area is off by {error:.1e} of itself after {terms} terms"
    return _row(float(terms), error, "" if error <= AREA_ERROR else reason)


def _relative(a: float, b: float) -> float:
    # An area below 1e-280 counts as zero.
    return abs(a - b) / max(abs(b), 1e-280)


def _package_areas(x: float, t: float) -> tuple[float, float, float]:
    areas = persson.areas(t, x, 1.0)
    return float(areas.elastic), float(areas.plastic), float(areas.separated)


def _eigenfunctions(s: float, t: float) -> tuple[int, tuple[float, float, float]]:
    """Elastic, plastic and separated area by the sine series, summed until it is constant."""
    elastic = force = 0.0
    for n in range(1, _TERMS + 1):
        decay = math.exp(-((n * math.pi) ** 2) * t)
        term = 2 / (n * math.pi) * math.sin(n * math.pi * s) * decay
        elastic += 2 * term if n % 2 else 0.0
        force += term if n % 2 else -term
        if decay < 1e-17:
            break
    return n, (elastic, s - force, 1 - elastic - (s - force))


def _images(s: float, t: float) -> tuple[int, tuple[float, float, float]]:
    """The same areas by the images of the start in the two walls."""
    c = 2 * math.sqrt(t)
    plastic = apart = 0.0
    for m in range(_TERMS):
        gained = math.erfc((2 * m + 1 - s) / c) - math.erfc((2 * m + 1 + s) / c)
        lost = math.erfc((2 * m + s) / c) - math.erfc((2 * m + 2 - s) / c)
        plastic, apart = plastic + gained, apart + lost
        if max(abs(gained), abs(lost)) < 1e-17:
            break
    return m + 1, (1 - plastic - apart, plastic, apart)


# --- finite elements -----------------------------------------------------------------------------


def _finite_elements(grid: Mapping[str, Any], methods: Sequence[str]) -> Any:
    del methods  # those of the boundary elements
    surface = rough_surface(grid["fem_points"])

    def row(method: str, x: float, y: float) -> dict[str, Any]:
        nu = float(method.removeprefix("nu = "))
        unit = 1e11 / (1 - nu**2) * 0.1  # E* xi in Pa
        scene = Scene(surface, Material(1e11, nu, yield_stress=unit / y), Load(x * unit))
        return _solved(
            lambda: fem_check.solve(scene, law="j2", steps=4),
            "newton_steps",
            lambda result: max(abs(r) for r in result.final.residuals.values()),
        )

    panels = [f"nu = {nu:g}" for nu in grid["poisson_ratios"]]
    axes = {"method": panels, "x": grid["fem_loads"], "y": grid["yield_ratios"]}
    return row, axes, ("p0 / (E* xi) (–)", "E* xi / yield stress (–)", "Newton steps")


def _capped(grid: Mapping[str, Any], methods: Sequence[str]) -> Any:
    return _boundary_elements(grid, methods, capped=True)


def _elastic(grid: Mapping[str, Any], methods: Sequence[str]) -> Any:
    return _boundary_elements(grid, methods, capped=False)


#: The function of each map: the row of a point, its axes, and the labels of x, y and effort.
MAPS = {"capped": _capped, "elastic": _elastic, "theory": _theory, "fem": _finite_elements}


def chart(table: pd.DataFrame, size: str) -> Chart:
    """The chart of the points of one map."""
    name, (x, y) = table["map"].iloc[0], (sorted(table[axis].unique()) for axis in "xy")
    effort = table["effort"].where(table["converged"])
    panels = {
        method: effort[group.index]
        .set_axis(pd.MultiIndex.from_frame(group[["x", "y"]]))
        .unstack()
        .reindex(index=x, columns=y)
        for method, group in table.groupby("method", sort=False)
    }
    *labels, count = MAPS[name](SIZES[size], ())[2]
    failed = int((~table["converged"]).sum())
    caption = f"{count} of each method on the {size} map; {failed} of {len(table)} failed."
    return draw_map(panels, x, y, labels=tuple(labels), count=count, caption=caption)


def write(table: pd.DataFrame, size: str, folder: Path | str) -> tuple[Path, ...]:
    """Write stability.json and, for each map, stability-<map>.png, .svg, .csv and .txt.

    Raises OutputError if a file cannot be written.
    """
    folder = Path(folder)
    content: dict[str, Any] = {
        "schema": "epcontact-stability-1",
        "size": size,
        "versions": package_versions(),
        "failures": int((~table["converged"]).sum()),
        "points": table.to_dict("records"),
    }
    paths = [folder / "stability.json"]
    write_json(paths[0], content)
    for name, points in table.groupby("map", sort=False):
        paths += chart(points, size).save(folder / f"stability-{name}")
    return tuple(paths)
