"""Maps of the parameters at which each method converges, with its failures.

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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import fem_check
from epcontact import bem, persson
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.files import write_json
from epcontact.harness.quantities.registry import measure
from epcontact.output.charts.maps import stability_map as draw_map
from epcontact.results import package_versions
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.studies.tables import Progress
from epcontact.surfaces import SelfAffine

MAPS = ("capped", "elastic", "theory", "fem")
#: Largest allowed violation of the contact conditions, measured by the harness, of a solve that
#: claims 1e-8; see `epcontact.harness.quantities.registry`.
EXAMINED = 1e-6
#: Relative error of an area up to which a sum of the theory counts as converged.
AREA_ERROR = 1e-9
_TERMS = 200
#: A division by zero counts as a failure like a report that the solver did not converge.
_FAILURES = (EpcontactError, ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Grid:
    """The sweep at one size: the axes of the maps, grid points and step limits."""

    points: int
    load_shares: tuple[float, ...]
    hardnesses: tuple[float, ...]
    loads: tuple[float, ...]
    diffusions: tuple[float, ...]
    baseline_steps: int
    fem_points: tuple[int, ...]
    poisson_ratios: tuple[float, ...]
    fem_loads: tuple[float, ...]
    yield_ratios: tuple[float, ...]


GRIDS: dict[str, Grid] = {
    "coarse": Grid(
        points=32,
        load_shares=(0.001, 0.1, 0.5, 0.99),
        hardnesses=(0.001, 0.1, 1.0, 100.0),
        loads=(0.001, 0.1, 1.0, 3.0),
        diffusions=(1e-4, 1e-2, 0.2, 1.0, 10.0),
        baseline_steps=500,
        fem_points=(32,),
        poisson_ratios=(0.0, 0.3, 0.499),
        fem_loads=(0.01, 0.2),
        yield_ratios=(0.5, 5.0, 50.0),
    ),
    "full": Grid(
        points=128,
        load_shares=(0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97, 0.99),
        hardnesses=(0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0),
        loads=(0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0),
        diffusions=tuple(np.geomspace(1e-6, 1e2, 17).tolist()),
        baseline_steps=1000,
        fem_points=(24, 24),
        poisson_ratios=(0.0, 0.2, 0.3, 0.4, 0.49, 0.499),
        fem_loads=(0.003, 0.01, 0.05, 0.2, 1.0),
        yield_ratios=(0.5, 2.0, 5.0, 15.0, 50.0),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Point:
    """One solve: its parameters, method, convergence, effort, residual and reason of failure.

    x, y: the groups of the map's axes; effort: transform pairs (bem), terms (theory) or Newton
    steps (fem); residual: dimensionless, of the examination.
    """

    map: str
    method: str
    x: float
    y: float
    converged: bool
    effort: float
    residual: float
    reason: str = ""


@dataclass(frozen=True)
class StabilityMap:
    """All points of a sweep."""

    size: str
    points: tuple[Point, ...]

    def of(self, name: str, method: str | None = None) -> tuple[Point, ...]:
        """The points of one map, or of one method on it."""
        return tuple(p for p in self.points if p.map == name and method in (None, p.method))

    @property
    def failures(self) -> tuple[Point, ...]:
        """The points that did not converge."""
        return tuple(p for p in self.points if not p.converged)


def stability_map(
    maps: Sequence[str] = MAPS,
    size: Literal["coarse", "full"] = "coarse",
    *,
    methods: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> StabilityMap:
    """Sweep the named maps.

    size: coarse (seconds) or full (minutes).  methods: of the boundary elements; None: all.
    progress: called with a sentence a point.

    Raises InvalidCase for a map or size that is not known.
    """
    unknown = [name for name in maps if name not in MAPS]
    if unknown or size not in GRIDS:
        raise InvalidCase(
            f"no stability map is called {unknown[0]!r}; there are {', '.join(MAPS)}"
            if unknown
            else f"size is {size!r}, but must be {' or '.join(GRIDS)}"
        )
    sweeps: dict[str, Callable[[Grid], Iterator[Point]]] = {
        "capped": lambda grid: _boundary_elements(grid, True, methods),
        "elastic": lambda grid: _boundary_elements(grid, False, methods),
        "theory": _theory,
        "fem": _finite_elements,
    }
    points = []
    for name in maps:
        for point in sweeps[name](GRIDS[size]):
            points.append(point)
            if progress is not None:
                what = f"{point.effort:g}" if point.converged else "failed"
                progress(f"{name} {point.method} at {point.x:g}, {point.y:g}: {what}")
    return StabilityMap(size, tuple(points))


# --- boundary elements ---------------------------------------------------------------------------


def rough_surface(shape: tuple[int, ...]) -> Surface:
    """Self-affine roughness of slope 0.1 with at least four points per shortest wave."""
    period, waves = 1e-3, max(4, min(shape) // 4)
    q0 = 2 * math.pi / period
    spectrum = SelfAffineSpectrum(0.8, q0, 2 * q0, waves * q0, 0.1)
    return SelfAffine(spectrum, (period,) * len(shape), shape, seed=1).build()


def _boundary_elements(grid: Grid, capped: bool, methods: Sequence[str] | None) -> Iterator[Point]:
    surface = rough_surface((grid.points, grid.points))
    unit = 1e11 * 0.1  # E* xi in Pa, Poisson's ratio being zero
    axes: tuple[Sequence[float], Sequence[float]]
    axes = (grid.load_shares, grid.hardnesses) if capped else (grid.loads, (math.inf,))
    for method, (x, y) in product(methods or bem.METHODS, product(*axes)):
        hardness = y * unit if capped else math.inf
        pressure = x * hardness if capped else x * unit
        scene = Scene(surface, Material(1e11, 0.0, hardness), Load(pressure))
        steps = None if method == "newton" else grid.baseline_steps
        where = ("capped" if capped else "elastic", method, x, y)
        yield _solved_by_bem(scene, where, steps)


def _solved_by_bem(scene: Scene, where: tuple[str, str, float, float], steps: int | None) -> Point:
    try:
        result = bem.solve(scene, method=where[1], threads=1, max_steps=steps)  # type: ignore[arg-type]
    except _FAILURES as error:
        residual = max(getattr(error, "residuals", {}).values(), default=math.nan)
        return Point(*where, False, math.nan, float(residual), _message(error))
    effort = float(result.cost["equivalent_fft_pairs"])
    names = [f"quantity.measured_{name}" for name in ("gap", "force", "bounds")]
    residual = max(abs(measure(name, scene, result)) for name in names)
    good = residual <= EXAMINED
    reason = "" if good else f"claims to have converged, but violates a condition by {residual:.1e}"
    return Point(*where, good, effort, residual, reason)


def _message(error: Exception) -> str:
    return str(error) if isinstance(error, EpcontactError) else f"{type(error).__name__}: {error}"


# --- theory --------------------------------------------------------------------------------------


def _theory(grid: Grid) -> Iterator[Point]:
    for method, x, t in product(("eigenfunctions", "images", "package"), grid.load_shares,
                                grid.diffusions):  # fmt: skip
        exact = _package_areas(x, t)
        if method == "package":
            mirrored = _package_areas(1 - x, t)
            errors = (
                abs(sum(exact) - 1),
                _relative(exact[1], mirrored[2]),
                _relative(exact[0], mirrored[0]),
            )
            yield _summed("package", x, t, 1, max(errors))
            continue
        terms, areas = _SUMS[method](x, t)
        error = max(_relative(a, b) for a, b in zip(areas, exact, strict=True))
        yield _summed(method, x, t, terms, error)


def _summed(method: str, x: float, t: float, terms: int, error: float) -> Point:
    good = error <= AREA_ERROR
    reason = "" if good else f"an area is off by {error:.1e} of itself after {terms} terms"
    return Point("theory", method, x, t, good, float(terms), error, reason)


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


_SUMS = {"eigenfunctions": _eigenfunctions, "images": _images}


# --- finite elements -----------------------------------------------------------------------------


def _finite_elements(grid: Grid) -> Iterator[Point]:
    surface = rough_surface(grid.fem_points)
    E, slope = 1e11, 0.1
    for nu, x, y in product(grid.poisson_ratios, grid.fem_loads, grid.yield_ratios):
        unit = E / (1 - nu**2) * slope
        material = Material(E, nu, yield_stress=unit / y)
        scene = Scene(surface, material, Load(x * unit))
        where = ("fem", f"nu = {nu:g}", x, y)
        try:
            result = fem_check.solve(scene, law="j2", steps=4)
        except _FAILURES as error:
            residual = max(getattr(error, "residuals", {}).values(), default=math.nan)
            yield Point(*where, False, math.nan, float(residual), _message(error))
            continue
        residual = max(abs(r) for r in result.final.residuals.values())
        yield Point(*where, True, float(result.cost["newton_steps"]), float(residual))


# --- files ---------------------------------------------------------------------------------------

_LABELS = {
    "capped": ("p0 / hardness (–)", "hardness / (E* xi) (–)", "transform pairs"),
    "elastic": ("p0 / (E* xi) (–)", "hardness / (E* xi) (–)", "transform pairs"),
    "theory": ("p0 / hardness (–)", "G / hardness^2 (–)", "terms"),
    "fem": ("p0 / (E* xi) (–)", "E* xi / yield stress (–)", "Newton steps"),
}


def write(data: StabilityMap, folder: Path | str) -> tuple[Path, ...]:
    """Write stability.json and, for each map, stability-<map>.png, .svg, .csv and .txt.

    Raises OutputError if a file cannot be written.
    """
    folder = Path(folder)
    content: dict[str, Any] = {
        "schema": "epcontact-stability-1",
        "size": data.size,
        "versions": package_versions(),
        "failures": len(data.failures),
        "points": [asdict(point) for point in data.points],
    }
    paths = [folder / "stability.json"]
    write_json(paths[0], content)
    for name in dict.fromkeys(point.map for point in data.points):
        points = data.of(name)
        x, y = (sorted({getattr(p, axis) for p in points}) for axis in ("x", "y"))
        tables: dict[str, NDArray[np.float64]] = {}
        for point in points:
            table = tables.setdefault(point.method, np.full((len(x), len(y)), np.nan))
            if point.converged:
                table[x.index(point.x), y.index(point.y)] = point.effort
        labels = _LABELS[name]
        failed = sum(not p.converged for p in points)
        caption = (
            f"{labels[2]} of each method on the {data.size} map; {failed} of {len(points)} failed."
        )
        chart = draw_map(tables, x, y, labels=labels[:2], count=labels[2], caption=caption)
        paths += chart.save(folder / f"stability-{name}")
    return tuple(paths)
