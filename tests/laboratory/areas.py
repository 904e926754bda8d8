"""Coverage of the error estimates of corrected areas, on many kinds of surfaces.

Each member of the ensemble is a surface of one of KINDS with a load, a hardness and a
number of points per shortest wavelength, all drawn by its seed.  Its reference is the
corrected area on a grid FINER times as fine.  The unit of pressure is E*, and the
slopes of most kinds are of order 1.  The constants of the error estimates come from
other seeds and scenes (`laboratory.area_bank`).

`python -m laboratory.areas [--full]` draws the chart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from epcontact import bem
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.output.charts.plot import Axis, Plot
from epcontact.results import Areas, FloatArray
from epcontact.scene import Body, Material
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    Study,
    tabulate,
)
from epcontact.studies.paper_scene import PARTS, self_affine
from laboratory import charts

#: Points of the reference's grid for each point of the coarse grid along a direction.
FINER = 8
#: The approximate rms height of the rough kinds.
_HEIGHT = 0.06
Random = np.random.Generator

#: A function that returns the heights of a kind on a patch: the grid of a `Member`, or
#: a finer one.
Maker = Callable[[Any, Random], Any]


def by_name(*makers: Any) -> dict[str, Callable[..., Any]]:
    """Return functions by their names, with spaces instead of underscores.

    The function `_truncated_cones`, one of the `makers`, gets the key "truncated
    cones".
    """
    return {maker.__name__.replace("_", " ").strip(): maker for maker in makers}


def roughness(
    patch: Member,
    rng: Random,
    low: float,
    high: float,
) -> Any:
    """Return self-affine heights on the grid of a patch, with the rms slope 1.

    Args:
        patch: The grid and the number of the shortest waves in a period.
        rng: Random numbers for the phases and the Hurst exponent.
        low: Smallest Hurst exponent.
        high: Largest Hurst exponent.
    """
    hurst = rng.uniform(low, high)
    seed = int(rng.integers(1 << 31))
    surface = self_affine(
        2 * math.pi, patch.shape, seed, patch.high, roll_off=2, hurst=hurst
    )
    return surface.heights


def _worn(patch: Member, rng: Random) -> Any:
    """Return heights of roughness whose summits are cut off.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    rough = roughness(patch, rng, 0.5, 0.95)
    return np.minimum(rough, rng.uniform(-0.2, 0.8) * _HEIGHT)


def _skewed(patch: Member, rng: Random) -> Any:
    """Return heights of roughness with a positive or negative skewness.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    rough = roughness(patch, rng, 0.5, 0.95)
    skew = rng.choice([-1, 1]) * rng.uniform(0.3, 1.0)
    return np.expm1(skew * rough / _HEIGHT) * _HEIGHT / skew


def _stepped(patch: Member, rng: Random) -> Any:
    """Return heights of roughness on two levels with straight steps between them.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    rough = roughness(patch, rng, 0.8, 0.8) * rng.uniform(0.1, 0.5)
    a, b = rng.choice([[1, 0], [1, 1], [2, 1], [1, 3]])
    phase = rng.uniform()
    x, y = patch.offsets()
    above = np.sin(2 * np.pi * (a * x + b * y + phase)) > 0
    return rough + rng.uniform(0.01, 0.1) * above


def _spheres(patch: Member, rng: Random) -> Any:
    """Return heights of a few round summits of different heights and radii.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(1, 6))):
        x, y = patch.offsets(rng.uniform(size=2))
        cap = rng.uniform(0, 0.05) - (x**2 + y**2) / (2 * rng.uniform(0.1, 0.4))
        heights = np.maximum(heights, cap)
    return heights


def _cylinders(patch: Member, rng: Random) -> Any:
    """Return heights of parallel round ridges in one of several directions.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    a, b = rng.choice([[1, 0], [1, 1], [2, 1], [0, 2], [3, 1]])
    x, y = patch.offsets()
    across = (a * x + b * y + rng.uniform()) % 1 - 0.5
    return -(across**2) / (2 * (a * a + b * b)) * rng.uniform(2, 8)


def _punches(patch: Member, rng: Random) -> Any:
    """Return heights of a few flat elliptic or rectangular posts.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    heights = np.zeros(patch.shape)
    depth = rng.uniform(0.02, 0.3)
    for _ in range(int(rng.integers(1, 4))):
        x, y = patch.offsets(rng.uniform(size=2))
        size = rng.uniform(0.08, 0.3)
        turn = rng.uniform(0, np.pi / 2)
        along = x * np.cos(turn) + y * np.sin(turn)
        across = y * np.cos(turn) - x * np.sin(turn)
        if rng.uniform() < 0.6:
            inside = along**2 + (across * rng.uniform(1, 2)) ** 2 <= size**2
        else:
            inside = (np.abs(along) <= 0.8 * size) & (np.abs(across) <= 0.6 * size)
        heights = np.where(inside, depth, heights)
    return heights


def _truncated_cones(patch: Member, rng: Random) -> Any:
    """Return heights of a cone with a flat top.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    x, y = patch.offsets(rng.uniform(size=2))
    flat = rng.uniform(0.1, 0.35)
    return -rng.uniform(0.1, 0.8) * np.maximum(np.hypot(x, y) - flat, 0)


def _dimples(patch: Member, rng: Random) -> Any:
    """Return heights of roughness with round dimples on a square lattice.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    rough = 0.1 * roughness(patch, rng, 0.8, 0.8)
    count = int(rng.integers(2, 5))
    u, v = _lattice(patch, rng, count)
    deep = (rng.uniform(0.2, 0.45) ** 2 - u**2 - v**2) / count**2
    return rough - np.maximum(0, deep / (2 * rng.uniform(0.2, 0.6)))


def _outliers(patch: Member, rng: Random) -> Any:
    """Return heights of roughness with narrow spikes.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    heights = roughness(patch, rng, 0.8, 0.8)
    for _ in range(int(rng.integers(3, 30))):
        x, y = patch.offsets(rng.uniform(size=2))
        width = rng.uniform(0.003, 0.012)
        height = rng.uniform(0.02, 0.2)
        heights = heights + height * np.exp(-(x**2 + y**2) / (2 * width**2))
    return heights


def _sharp_cones(patch: Member, rng: Random) -> Any:
    """Return heights of pointed cones on a square lattice.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    count = int(rng.integers(1, 4))
    u, v = _lattice(patch, rng, count)
    return -rng.uniform(0.3, 1.0) * np.hypot(u, v) / count


def _honed(patch: Member, rng: Random) -> Any:
    """Return heights of roughness with grooves in two crossing directions.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    heights = rng.uniform(0.05, 0.3) * roughness(patch, rng, 0.8, 0.8)
    x, y = patch.offsets()
    width = rng.uniform(0.05, 0.2)
    for side in (-1, 1):
        a = int(rng.integers(1, 4))
        b = side * int(rng.integers(1, 4))
        distance = np.abs((2 * (a * x + b * y) + rng.uniform()) % 1 - 0.5)
        depth = 0.7 * np.maximum(width - distance, 0)
        heights = heights - depth / (2 * math.hypot(a, b))
    return heights


def _quantised(patch: Member, rng: Random) -> Any:
    """Return heights of roughness that are rounded to a few levels.

    They are on the grid of a `patch`, in the unit of its periods, and `rng` draws their
    random parameters.
    """
    rough = roughness(patch, rng, 0.5, 0.95)
    levels = int(rng.integers(6, 41))
    step = 6 * _HEIGHT / levels
    return np.round(rough / step) * step


def _lattice(
    patch: Member,
    rng: Random,
    count: int,
) -> tuple[Any, Any]:
    """Return signed distances from the nearest node of a randomly shifted lattice.

    They are coordinates along x, (nx, 1), and along y, (1, ny), of the grid points of
    the patch, in units of the lattice's spacing, which is the period over `count`.
    """
    x, y = patch.offsets()
    u = (count * x + rng.uniform()) % 1 - 0.5
    v = (count * y + rng.uniform()) % 1 - 0.5
    return u, v


#: The functions of each kind.  Elliptic roughness is isotropic roughness on other
#: periods, and oblong roughness has cells of 2 to 1.
KINDS: dict[str, Maker] = dict.fromkeys(
    ("self-affine", "elliptic", "oblong"), partial(roughness, low=0.2, high=0.95)
)
KINDS |= by_name(
    _worn,
    _skewed,
    _stepped,
    _spheres,
    _cylinders,
    _punches,
    _truncated_cones,
    _dimples,
    _outliers,
    _sharp_cones,
    _honed,
    _quantised,
)


@dataclass(frozen=True)
class Member:
    """One surface of an ensemble, with its load and hardness.

    Attributes:
        shape: Shape of the coarse grid.
        periods: Periods along x and y.
        load: Mean pressure over E*.
        hardness: Hardness over E*; infinite for an elastic body.
        high: Number of the shortest waves in a period of the rough kinds.
        maker: The function of the kind.
        drawn: Seed of the random numbers that this function takes.
    """

    shape: tuple[int, int]
    periods: tuple[float, float]
    load: float
    hardness: float
    high: int
    maker: Maker
    drawn: int

    def offsets(
        self, centre: FloatArray | Sequence[float] = (0.0, 0.0)
    ) -> tuple[Any, Any]:
        """Return the signed distances of the grid points from a point.

        They are those to the nearest periodic image of `centre` (x, y), along x with
        the shape (nx, 1) and along y with (1, ny), in the unit of the periods.
        """
        offsets = []
        for n, c, length in zip(self.shape, centre, self.periods, strict=True):
            x = np.arange(n) * (length / n) - c
            offsets.append((x + length / 2) % length - length / 2)
        x_offsets, y_offsets = offsets
        return x_offsets[:, None], y_offsets[None, :]

    def solved(
        self, factor: int
    ) -> tuple[FloatArray, FloatArray, float, list[float], float]:
        """Return the `solution` of this surface on a grid `factor` times as fine.

        It holds the arguments of `estimate_areas`.  Raises NotConverged.
        """
        fine = replace(self, shape=(factor * self.shape[0], factor * self.shape[1]))
        heights = self.maker(fine, np.random.default_rng(self.drawn))
        return solution(heights, self.load, self.hardness, self.periods)

    def areas(self, factor: int) -> tuple[Areas, Areas, Areas]:
        """Return raw areas, corrected areas and error estimates of this surface.

        All are fractions of the nominal area, on a grid `factor` times as fine as the
        coarse one.  Raises NotConverged.
        """
        return estimate_areas(*self.solved(factor))


def solution(
    heights: FloatArray,
    load: float,
    hardness: float = math.inf,
    periods: tuple[float, ...] | None = None,
) -> tuple[FloatArray, FloatArray, float, list[float], float]:
    """Solve a surface with E* = 1 and return the arguments of `estimate_areas`.

    Args:
        heights: Heights, (nx, ny) or (n,).
        load: Mean pressure over E*.
        hardness: Hardness over E*; infinite for an elastic body.
        periods: Periods; None: 1 along each direction.

    Returns:
        Pressure over E* and gap, both on the grid, hardness over E*, grid spacings
        along each direction, and E*, which is 1.

    Raises:
        NotConverged: The solver misses its tolerance.
    """
    periods = periods or (1.0,) * heights.ndim
    q = rfft_wavenumbers(heights.shape, periods)
    compliance = surface_compliance(q, Body(), Material(1.0, 0.0))
    options = bem.Options(tolerance=1e-7)
    solved = bem.solve_pressure(heights, compliance, load, hardness, options=options)
    spacing = [length / n for length, n in zip(periods, heights.shape, strict=True)]
    return solved.pressure, solved.gap(heights), hardness, spacing, 1.0


def member(
    makers: Mapping[str, Maker],
    kind: str,
    seed: int,
    points: int,
) -> Member:
    """Draw a member of the ensemble.

    Args:
        makers: Functions of the kinds by name.
        kind: Name of the kind.
        seed: Seed of the draw.
        points: Approximate number of points along a side of the coarse grid.
    """
    rng = np.random.default_rng([seed, *kind.encode()])
    per_wave = rng.choice([3, 4, 4, 4, 6, 8, 16])
    stretched = kind in ("elliptic", "oblong")
    shape = (points, points)
    if stretched:
        shape = (3 * points // 4, 3 * points // 2)
    hardness = math.inf
    if rng.uniform() < 0.6:
        hardness = 10 ** rng.uniform(-1.3, 0.3)
    load = min(10 ** rng.uniform(-2.5, 0.3), 0.9 * hardness)
    high = max(int(min(shape) // per_wave), 2)
    periods = (1.0, 2.0 if kind == "elliptic" else 1.0)
    drawn = int(rng.integers(1 << 31))
    return Member(
        shape,
        periods,
        load,
        hardness,
        high,
        makers[kind],
        drawn,
    )


def judged(kind: str, seed: int, points: int) -> Rows:
    """Return the error over the error estimate for each area of a member.

    The error is the difference of the corrected area from that on a grid FINER times as
    fine, less the solver's tolerance.

    Args:
        kind: Name in KINDS.
        seed: Seed of the draw.
        points: Approximate number of points along a side of the coarse grid.

    Returns:
        Rows with `part` (total, elastic or plastic) and `times`, the ratio.  Areas
        whose error and error estimate are 0 are left out.

    Raises:
        NotConverged: A solve misses its tolerance.
    """
    drawn = member(KINDS, kind, seed, points)
    _, corrected, estimate = drawn.areas(1)
    _, exact, _ = drawn.areas(FINER)
    parts = PARTS if math.isfinite(drawn.hardness) else ("total",)
    rows = []
    for part in parts:
        difference = abs(getattr(corrected, part) - getattr(exact, part))
        error = max(difference - 1e-9, 0.0)
        estimated = getattr(estimate, part)
        if error > 0 or estimated > 0:
            rows.append({"part": part, "times": error / max(estimated, 1e-9)})
    return rows


def areas(
    say: Say,
    seeds: Ints = range(100, 104),
    points: int = 32,
    kinds: Sequence[str] = tuple(KINDS),
) -> Charts:
    """Coverage of the error estimates of corrected areas, by kind of surface.

    Each mark is an area, at .001 or 100 if beyond; the truth is a grid 8 times as fine.
    Loads are .003 to 2 E*, the hardness .05 to 2 E* or none, with 3 to 16 points a
    shortest wave.
    """
    table = tabulate(
        say,
        judged,
        seed=seeds,
        kind=kinds,
        points=[points],
    )
    table["times"] = table["times"].clip(1e-3, 1e2)
    covered = table["times"] <= 1
    coverage = covered.groupby(table["kind"], sort=False).mean()[::-1]
    rows = list(coverage.index)
    table["row"] = table["kind"].map(rows.index)
    table["all"] = "kinds"  # one colour for all of them
    names = [f"{kind}, {fraction:.0%}" for kind, fraction in coverage.items()]
    ticks = {
        "yticks": range(len(names)),
        "yticklabels": names,
        "ylim": (-0.7, len(names)),
    }
    plot = Plot(
        Axis("times", "error over its estimate (–)"),
        Axis("row", "kind, fraction within its estimate (–)"),
        ("kind",),
        style="open",
        colour="all",
        log="x",
        labels=dict.fromkeys(rows, "_"),
        upright={"estimated": 1.0},
        limits=ticks,
    )
    caption = (
        "Do the error estimates of the areas cover the errors? "
        f"Of {len(table)} areas {covered.mean():.0%} are within their error estimate."
    )
    yield plot, table.drop(columns="seed"), caption


STUDY = Study("areas", areas, {"seeds": range(100, 130), "points": 64})

if __name__ == "__main__":
    charts.save(STUDY)
