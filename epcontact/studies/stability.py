"""The study of stability: the parameters at which each method converges.

capped   boundary elements, p0/hardness against hardness/(E* xi): the Newton solver and
         each baseline
elastic  the same for an infinite hardness, against p0/(E* xi) alone
theory   p0/hardness against G/hardness^2: the eigenfunctions, the images, and the
         package, which chooses between them; effort is the number of terms, residual
         the relative error of the areas
fem      p0/(E* xi) against E* xi/yield_stress: J2 half-blocks, one panel for each
         Poisson's ratio

A point counts as converged only if the result also passes a check that is independent
of the method: the contact conditions measured on the pressure field by other transforms
(capped, elastic), the conservation of force and the particle-hole symmetry of the areas
(theory), the balance by scikit-fem's assembly (fem).
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
from epcontact.studies.baselines import METHODS
from epcontact.studies.frame import Say, tabulate
from epcontact.studies.paper_scene import self_affine

#: Largest allowed violation of the contact conditions, measured by the harness, of a
#: solve to 1e-8.
EXAMINED = 1e-6
#: Relative error of an area up to which a sum of the theory has converged.
AREA_ERROR = 1e-9
#: Most terms of a sum.
_TERMS = 200
#: A division by zero counts as a failure like an error of the solver.
_FAILURES = (EpcontactError, ArithmeticError, np.linalg.LinAlgError)

#: The labels of x, y and effort on each map, and what converges there.
MAPS = {
    "capped": (
        "p0 / hardness (–)",
        "hardness / (E* xi) (–)",
        "transform pairs",
        "boundary elements of a capped body",
    ),
    "elastic": (
        "p0 / (E* xi) (–)",
        "hardness / (E* xi) (–)",
        "transform pairs",
        "boundary elements of an elastic body",
    ),
    "theory": ("p0 / hardness (–)", "G / hardness² (–)", "terms", "sums of the theory"),
    "fem": (
        "p0 / (E* xi) (–)",
        "E* xi / yield stress (–)",
        "Newton steps",
        "finite elements with J2 flow",
    ),
}
_SHARES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97, 0.99)
_RATIOS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
_LOADS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
#: For each size the axes x and y of each map, Poisson's ratios, grid points and limits
#: of steps.
SIZES: dict[str, dict[str, Any]] = {
    "coarse": {
        "capped": ((0.001, 0.1, 0.5, 0.99), (0.001, 0.1, 1.0, 100.0)),
        "elastic": ((0.001, 0.1, 1.0, 3.0), (math.inf,)),
        "theory": ((0.001, 0.1, 0.5, 0.99), (1e-4, 1e-2, 0.2, 1.0, 10.0)),
        "fem": ((0.01, 0.2), (0.5, 5.0, 50.0)),
        "poisson_ratios": (0.0, 0.3, 0.499),
        "points": (32, 32),
        "fem_points": (32,),
        "baseline_steps": 500,
    },
    "full": {
        "capped": (_SHARES, _RATIOS),
        "elastic": (_LOADS, (math.inf,)),
        "theory": (_SHARES, tuple(np.geomspace(1e-6, 1e2, 17).tolist())),
        "fem": ((0.003, 0.01, 0.05, 0.2, 1.0), (0.5, 2.0, 5.0, 15.0, 50.0)),
        "poisson_ratios": (0.0, 0.2, 0.3, 0.4, 0.49, 0.499),
        "points": (128, 128),
        "fem_points": (24, 24),
        "baseline_steps": 1000,
    },
}


def stability(
    maps: Sequence[str] = (),
    size: str = "coarse",
    *,
    methods: Sequence[str] = tuple(METHODS),
    say: Say = lambda _: None,
) -> pd.DataFrame:
    """Solve every point of the stability maps.

    Args:
        maps: Names of the maps; none: all.
        size: "coarse" (seconds) or "full" (minutes).
        methods: Methods of the boundary elements.
        say: Called with a sentence before each solve.

    Returns:
        A row for each solve: map, method, x, y, converged, effort, residual (of the
        check) and the reason of a failure.

    Raises:
        InvalidCase: A map or the size is not known.
    """
    for name in maps:
        if name not in MAPS:
            raise InvalidCase(
                f"no stability map is called {name!r}; there are {', '.join(MAPS)}"
            )
    if size not in SIZES:
        raise InvalidCase(f"size is {size!r}, but must be {' or '.join(SIZES)}")
    settings = SIZES[size]
    surface = _surface(settings["points"])
    block = _surface(settings["fem_points"])
    boundary_elements = partial(_boundary_elements, surface, settings["baseline_steps"])
    panels = [f"nu = {nu:g}" for nu in settings["poisson_ratios"]]
    solvers: dict[str, tuple[Callable[..., Any], Sequence[str]]] = {
        "capped": (boundary_elements, methods),
        "elastic": (boundary_elements, methods),
        "theory": (_sum, ("eigenfunctions", "images", "package")),
        "fem": (partial(_finite_elements, block), panels),
    }
    tables = []
    for name in maps or MAPS:
        row, methods_of_map = solvers[name]
        x, y = settings[name]
        say(f"the map {name}")
        table = tabulate(
            say,
            row,
            method=methods_of_map,
            x=x,
            y=y,
        )
        table.insert(0, "map", name)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _surface(shape: tuple[int, ...]) -> Surface:
    """Return self-affine roughness on a grid of some shape, with the rms slope 0.1.

    It has four points per shortest wave, on small grids fewer.
    """
    shortest = max(4, min(shape) // 4)
    return self_affine(
        2e3 * math.pi,
        shape,
        1,
        shortest,
        roll_off=2,
        slope=0.1,
    )


def _solve_and_check(
    solve: Callable[[], ContactResult],
    effort: str,
    check: Callable[[ContactResult], float],
) -> dict[str, Any]:
    """Solve a point of a map, check the result, and return its columns.

    Args:
        solve: Returns the result; an error of the solver counts as a failure.
        effort: Key of the result's cost that is the effort.
        check: Returns the largest violation of a condition by a result, dimensionless;
            more than EXAMINED is a failure.

    Returns:
        The columns of `_row`.
    """
    try:
        result = solve()
    except _FAILURES as error:
        residuals = getattr(error, "residuals", {})
        residual = float(max(residuals.values(), default=math.nan))
        reason = str(error)
        if not isinstance(error, EpcontactError):
            reason = f"{type(error).__name__}: {reason}"
        return _row(math.nan, residual, reason)
    residual = check(result)
    reason = ""
    if residual > EXAMINED:
        reason = f"claims to have converged, but violates a condition by {residual:.1e}"
    return _row(float(result.cost[effort]), residual, reason)


def _row(
    effort: float,
    residual: float,
    reason: str,
) -> dict[str, Any]:
    """Return the columns of a solve for the table of `stability`.

    Args:
        effort: Transform pairs, terms or Newton steps, by the map.
        residual: Largest residual or violation of a condition.
        reason: Reason of the failure; empty if the solve converged.
    """
    return {
        "converged": not reason,
        "effort": effort,
        "residual": residual,
        "reason": reason,
    }


def _boundary_elements(
    surface: Surface, most_steps: int, method: str, x: float, y: float
) -> Any:
    """Return the row of a solve by boundary elements at a point of the map.

    Args:
        surface: The surface, of rms slope 0.1.
        most_steps: Most steps of a baseline.
        method: A name of `baselines.METHODS`.
        x: p0 over the hardness, or over E* xi if the hardness is infinite.
        y: Hardness over E* xi.
    """
    unit = 1e11 * 0.1  # E* xi in Pa with a Poisson's ratio of zero
    pressure = x * (y * unit if math.isfinite(y) else unit)
    scene = Scene(surface, Material(1e11, 0.0, y * unit), Load(pressure))
    steps = None if method == "newton" else most_steps

    def solve() -> ContactResult:
        """Solve the scene by boundary elements."""
        return bem.solve(scene, method=METHODS[method], threads=1, max_steps=steps)

    def check(result: ContactResult) -> float:
        """Return the largest violation of a contact condition, dimensionless.

        It is measured on the fields of the result, independently of the solver.
        """
        names = ("measured_gap", "measured_force", "measured_bounds")
        return max(abs(measure(f"quantity.{name}", scene, result)) for name in names)

    return _solve_and_check(solve, "equivalent_fft_pairs", check)


def _finite_elements(
    surface: Surface,
    method: str,
    x: float,
    y: float,
) -> Any:
    """Return the row of a solve by finite elements with J2 flow at a point of the map.

    Args:
        surface: The surface, of rms slope 0.1.
        method: "nu = " with Poisson's ratio.
        x: p0 over E* xi.
        y: E* xi over the yield stress.
    """
    nu = float(method.removeprefix("nu = "))
    unit = 1e11 / (1 - nu**2) * 0.1  # E* xi in Pa
    scene = Scene(surface, Material(1e11, nu, yield_stress=unit / y), Load(x * unit))

    def solve() -> ContactResult:
        """Solve the scene by finite elements with J2 flow."""
        return fem_check.solve(scene, law="j2", steps=4)

    def check(result: ContactResult) -> float:
        """Return the largest residual of the balance of forces of a result."""
        return max(abs(r) for r in result.final.residuals.values())

    return _solve_and_check(solve, "newton_steps", check)


def _sum(method: str, x: float, y: float) -> Any:
    """Return the row of the theory's areas by a method at a point of the map.

    The sums are compared with the package, and the package with its mirror image.

    Args:
        method: "eigenfunctions", "images" or "package".
        x: p0 over the hardness.
        y: G over the hardness squared.
    """

    def package(load: float) -> tuple[float, float, float]:
        """Return elastic, plastic and separated area as fractions, by the package.

        `load` is p0 over the hardness.
        """
        areas = persson.areas(y, load, 1.0)
        return float(areas.elastic), float(areas.plastic), float(areas.separated)

    def relative_error(value: float, reference: float) -> float:
        """Return the relative error of a value.

        A reference of less than 1e-280, such as 0, counts as 1e-280.
        """
        return abs(value - reference) / max(abs(reference), 1e-280)

    exact = package(x)
    elastic, plastic, _ = exact
    if method == "package":
        terms = 1
        mirrored_elastic, _, mirrored_separated = package(1 - x)
        error = max(
            abs(sum(exact) - 1),
            relative_error(plastic, mirrored_separated),
            relative_error(elastic, mirrored_elastic),
        )
    else:
        function = _eigenfunctions if method == "eigenfunctions" else _images
        terms, areas = function(x, y)
        error = max(relative_error(a, b) for a, b in zip(areas, exact, strict=True))
    reason = ""
    if not error <= AREA_ERROR:
        reason = f"an area is off by {error:.1e} of itself after {terms} terms"
    return _row(float(terms), error, reason)


def _eigenfunctions(s: float, t: float) -> tuple[int, tuple[float, float, float]]:
    """Return the theory's areas by the sine series, and the number of its terms.

    Args:
        s: p0 over the hardness.
        t: G over the hardness squared.

    Returns:
        The number of terms, and elastic, plastic and separated area as fractions of the
        nominal area.
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
    """Return the theory's areas by images of the source in the two bounds.

    The bounds are those of the pressure, 0 and the hardness.

    Args:
        s: p0 over the hardness.
        t: G over the hardness squared.

    Returns:
        The number of terms, and elastic, plastic and separated area as fractions of the
        nominal area.
    """
    c = 2 * math.sqrt(t)
    plastic = separated = 0.0
    for m in range(_TERMS):
        at_hardness = math.erfc((2 * m + 1 - s) / c) - math.erfc((2 * m + 1 + s) / c)
        at_zero = math.erfc((2 * m + s) / c) - math.erfc((2 * m + 2 - s) / c)
        plastic += at_hardness
        separated += at_zero
        if max(abs(at_hardness), abs(at_zero)) < 1e-17:
            break
    return m + 1, (1 - plastic - separated, plastic, separated)


def chart(table: pd.DataFrame, size: str) -> Chart:
    """Return the chart of one map, with a panel for each method.

    `table` has the rows of `stability` for this map.  `size` ("coarse" or "full") is
    named in the caption.
    """
    x_label, y_label, count, solvers = MAPS[table["map"].iloc[0]]
    shown = table.assign(effort=table["effort"].where(table["converged"]))
    panels = {}
    for method, group in shown.groupby("method", sort=False):
        panels[method] = group.pivot(index="x", columns="y", values="effort")
    caption = (
        f"The {count} that each method takes.  Crosses: it did not converge, or "
        f"violates a condition of contact; {_failed(table)} of {len(table)} failed "
        f"({size} map)."
    )
    x = sorted(table["x"].unique())
    y = sorted(table["y"].unique())
    labels = (x_label, y_label)
    return stability_map(
        panels,
        x,
        y,
        labels=labels,
        count=count,
        caption=caption,
        question=f"Where do {solvers} converge?",
    )


def write(
    table: pd.DataFrame,
    size: str,
    folder: Path | str,
) -> tuple[Path, ...]:
    """Write stability.json and the charts of the maps, and return the paths.

    The chart of each map has four files.

    Args:
        table: The rows of `stability`.
        size: "coarse" or "full", which the files name.
        folder: Folder of the files.

    Raises:
        OutputError: A file cannot be written.
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
    """Return the number of solves in the rows of `stability` that did not converge."""
    return int((~table["converged"]).sum())
