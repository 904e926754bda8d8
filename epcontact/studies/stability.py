"""The study of stability: the parameters at which each method converges, with its
failures.

capped   boundary elements, p0/hardness against hardness/(E* xi): the Newton solver, each baseline
elastic  the same for an infinite hardness, against p0/(E* xi) alone
theory   p0/hardness against G/hardness^2: the eigenfunctions, the images, and what the package
         makes of them; effort is the number of terms, residual the relative error of
         the areas
fem      p0/(E* xi) against E* xi/yield_stress: J2 half-blocks, one panel a Poisson's ratio

A point counts as converged only if the answer also passes a check that is independent
of the method: the contact conditions measured on the pressure field by other transforms
(capped, elastic), the conservation of force and the particle-hole symmetry of the areas
(theory), the balance as scikit-fem's assembly finds it (fem).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
from epcontact.output.charts.maps import stability_map
from epcontact.results import ContactResult, package_versions
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.studies.frame import Say, rows
from epcontact.studies.paper_scene import self_affine

#: Largest allowed violation of the contact conditions, measured by the harness, of a
#: solve that claims 1e-8, and relative error of an area up to which a sum of the theory
#: has converged.
EXAMINED, AREA_ERROR = 1e-6, 1e-9
_TERMS = 200
#: A division by zero counts as a failure like a report that the solver did not
#: converge.
_FAILURES = (EpcontactError, ArithmeticError, np.linalg.LinAlgError)

#: The labels of x, y and effort on each map.
MAPS = {
    "capped": ("p0 / hardness (–)", "hardness / (E* xi) (–)", "transform pairs"),
    "elastic": ("p0 / (E* xi) (–)", "hardness / (E* xi) (–)", "transform pairs"),
    "theory": ("p0 / hardness (–)", "G / hardness² (–)", "terms"),
    "fem": ("p0 / (E* xi) (–)", "E* xi / yield stress (–)", "Newton steps"),
}
_SHARES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97, 0.99)
_RATIOS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
_LOADS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
#: The axes x and y of each map, Poisson's ratios, and grid points and step limits, by
#: size.
SIZES: dict[str, dict[str, Any]] = {
    "coarse": {
        "capped": ((0.001, 0.1, 0.5, 0.99), (0.001, 0.1, 1.0, 100.0)),
        "elastic": ((0.001, 0.1, 1.0, 3.0), (math.inf,)),
        "theory": ((0.001, 0.1, 0.5, 0.99), (1e-4, 1e-2, 0.2, 1.0, 10.0)),
        "fem": ((0.01, 0.2), (0.5, 5.0, 50.0)),
        "poisson_ratios": (0.0, 0.3, 0.499),
        **{"points": (32, 32), "fem_points": (32,), "baseline_steps": 500},
    },
    "full": {
        "capped": (_SHARES, _RATIOS),
        "elastic": (_LOADS, (math.inf,)),
        "theory": (_SHARES, tuple(np.geomspace(1e-6, 1e2, 17).tolist())),
        "fem": ((0.003, 0.01, 0.05, 0.2, 1.0), (0.5, 2.0, 5.0, 15.0, 50.0)),
        "poisson_ratios": (0.0, 0.2, 0.3, 0.4, 0.49, 0.499),
        **{"points": (128, 128), "fem_points": (24, 24), "baseline_steps": 1000},
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

    `methods` are those of the boundary elements.  Returns a row for each solve: map,
    method, x, y, converged, effort, residual (of the examination) and the reason of a
    failure.  Raises InvalidCase for a map or size that is not known.
    """
    if unknown := [name for name in maps if name not in MAPS]:
        raise InvalidCase(
            f"no stability map is called {unknown[0]!r}; there are {', '.join(MAPS)}"
        )
    if size not in SIZES:
        raise InvalidCase(f"size is {size!r}, but must be {' or '.join(SIZES)}")
    grid, tables = SIZES[size], []
    surface, block = (  # at least four points per shortest wave
        self_affine(
            2e3 * math.pi, shape, 1, max(4, min(shape) // 4), roll_off=2, slope=0.1
        )
        for shape in (grid["points"], grid["fem_points"])
    )
    capped = partial(_boundary_elements, surface, grid["baseline_steps"]), methods
    panels = [f"nu = {nu:g}" for nu in grid["poisson_ratios"]]
    solvers: dict[str, tuple[Callable[..., Any], Sequence[str]]] = {
        "theory": (_sum, ("eigenfunctions", "images", "package")),
        "fem": (partial(_finite_elements, block), panels),
    }
    for name in maps or MAPS:
        (row, of_map), (x, y) = solvers.get(name, capped), grid[name]
        say(f"the map {name}")
        tables.append(rows(say, row, method=of_map, x=x, y=y))
        tables[-1].insert(0, "map", name)
    return pd.concat(tables, ignore_index=True)


def _solved(
    solve: Callable[[], ContactResult],
    effort: str,
    examine: Callable[[ContactResult], float],
) -> dict[str, Any]:
    """Return a row that says if a solve converges and passes the examination, and its
    effort.
    """
    try:
        result = solve()
    except _FAILURES as error:
        residual = float(
            max(getattr(error, "residuals", {}).values(), default=math.nan)
        )
        kind = "" if isinstance(error, EpcontactError) else f"{type(error).__name__}: "
        return _row(math.nan, residual, f"{kind}{error}")
    residual = examine(result)
    reason = f"claims to have converged, but violates a condition by {residual:.1e}"
    return _row(
        float(result.cost[effort]), residual, "" if residual <= EXAMINED else reason
    )


def _row(effort: float, residual: float, reason: str) -> dict[str, Any]:
    return {
        "converged": not reason,
        "effort": effort,
        "residual": residual,
        "reason": reason,
    }


def _boundary_elements(
    surface: Surface, most_steps: int, method: str, x: float, y: float
) -> Any:
    unit = 1e11 * 0.1  # E* xi in Pa, Poisson's ratio being zero
    pressure = x * (y * unit if math.isfinite(y) else unit)
    scene = Scene(surface, Material(1e11, 0.0, y * unit), Load(pressure))
    steps = None if method == "newton" else most_steps
    names = [f"quantity.measured_{name}" for name in ("gap", "force", "bounds")]
    return _solved(
        lambda: bem.solve(scene, method=method, threads=1, max_steps=steps),  # type: ignore[arg-type]
        "equivalent_fft_pairs",
        lambda result: max(abs(measure(name, scene, result)) for name in names),
    )


def _finite_elements(surface: Surface, method: str, x: float, y: float) -> Any:
    nu = float(method.removeprefix("nu = "))
    unit = 1e11 / (1 - nu**2) * 0.1  # E* xi in Pa
    scene = Scene(surface, Material(1e11, nu, yield_stress=unit / y), Load(x * unit))
    return _solved(
        lambda: fem_check.solve(scene, law="j2", steps=4),
        "newton_steps",
        lambda result: max(abs(r) for r in result.final.residuals.values()),
    )


def _sum(method: str, x: float, y: float) -> Any:
    """The error of the areas by a method; the package's own are judged by their
    symmetry.
    """

    def package(share: float) -> tuple[float, float, float]:
        areas = persson.areas(y, share, 1.0)
        return float(areas.elastic), float(areas.plastic), float(areas.separated)

    def off(a: float, b: float) -> float:
        return abs(a - b) / max(abs(b), 1e-280)  # a smaller area counts as zero

    exact, terms = package(x), 1
    if method == "package":
        mirrored = package(1 - x)
        error = max(
            abs(sum(exact) - 1), off(exact[1], mirrored[2]), off(exact[0], mirrored[0])
        )
    else:
        terms, areas = (_eigenfunctions if method == "eigenfunctions" else _images)(
            x, y
        )
        error = max(off(a, b) for a, b in zip(areas, exact, strict=True))
    reason = f"an area is off by {error:.1e} of itself after {terms} terms"
    return _row(float(terms), error, "" if error <= AREA_ERROR else reason)


def _eigenfunctions(s: float, t: float) -> tuple[int, tuple[float, float, float]]:
    """Elastic, plastic and separated area by the sine series, summed until it is
    constant.
    """
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


def chart(table: pd.DataFrame, size: str) -> Chart:
    """The chart of the points of one map."""
    *labels, count = MAPS[table["map"].iloc[0]]
    shown = table.assign(effort=table["effort"].where(table["converged"]))
    panels = {
        method: group.pivot(index="x", columns="y", values="effort")
        for method, group in shown.groupby("method", sort=False)
    }
    caption = (
        f"The {count} that each method takes.  Crosses: it did not converge, or violates "
        f"a condition of contact; {_failed(table)} of {len(table)} failed ({size} map)."
    )
    x, y = (sorted(table[axis].unique()) for axis in "xy")
    return stability_map(
        panels, x, y, labels=(labels[0], labels[1]), count=count, caption=caption
    )


def write(table: pd.DataFrame, size: str, folder: Path | str) -> tuple[Path, ...]:
    """Write stability.json and, for each map, stability-<map>.png, .svg, .csv and
    .txt.
    """
    paths = [Path(folder) / "stability.json"]
    content = {
        "schema": "epcontact-stability-1",
        "size": size,
        "versions": package_versions(),
        "failures": _failed(table),
        "points": table.to_dict("records"),
    }
    write_json(paths[0], content)
    for name, points in table.groupby("map", sort=False):
        paths += chart(points, size).save(paths[0].with_name(f"stability-{name}"))
    return tuple(paths)


def _failed(table: pd.DataFrame) -> int:
    return int((~table["converged"]).sum())
