"""Are the claimed errors of corrected areas true?  An ensemble of many kinds of surfaces.

Each member of the ensemble is a surface of one of KINDS with a load, a hardness and a number of
points per shortest wavelength, all drawn by its seed.  It is solved on a coarse grid and on one
that is FINER times as fine in each direction, whose corrected areas are the reference: their own
errors are smaller by that factor at edges, and by more elsewhere.  The unit of pressure is E* and
the slopes of most kinds are of order 1.

The error constants of `epcontact.bem.areas.rim_correction` come from other kinds
(`laboratory.error_bars`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.kernel import rfft_wavenumbers
from epcontact.output.charts.plot import Plot
from epcontact.results import Areas, FloatArray
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.frame import Charts, Say, listed, study
from epcontact.studies.paper_scene import PARTS
from epcontact.surfaces import SelfAffine

#: The reference has so many points for each point of the coarse grid along a direction.
FINER = 8
#: An area below this is too small for relative figures.
SMALLEST = 1e-4
_HEIGHT = 0.06  # about the rms height of the rough kinds


@dataclass(frozen=True)
class Patch:
    """Where the heights of a surface are needed: a grid of `shape` on `periods`.

    high: shortest waves per period of the rough kinds.
    """

    shape: tuple[int, int]
    periods: tuple[float, float]
    high: int

    def offsets(self, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(nx, 1) and (1, ny) distances from the nearest image of a centre."""
        x, y = (
            (np.arange(n) * (length / n) - c + length / 2) % length - length / 2
            for n, length, c in zip(self.shape, self.periods, centre, strict=True)
        )
        return x[:, None], y[None, :]


#: Makes heights of a kind on a patch.
Maker = Callable[[Patch, np.random.Generator], FloatArray]


def _rough(patch: Patch, rng: np.random.Generator, low: float, high: float) -> FloatArray:
    """Self-affine roughness of rms slope 1; its Hurst exponent is drawn between two numbers."""
    wave = 2 * math.pi
    spectrum = SelfAffineSpectrum(rng.uniform(low, high), wave, 2 * wave, patch.high * wave, 1.0)
    surface = SelfAffine(spectrum, (1.0, 1.0), patch.shape, int(rng.integers(1 << 31)))
    return surface.build().heights


def _self_affine(patch: Patch, rng: np.random.Generator) -> FloatArray:
    return _rough(patch, rng, 0.2, 0.95)


def _worn(patch: Patch, rng: np.random.Generator) -> FloatArray:
    return np.minimum(_rough(patch, rng, 0.5, 0.95), rng.uniform(-0.2, 0.8) * _HEIGHT)


def _skewed(patch: Patch, rng: np.random.Generator) -> FloatArray:
    rough, skew = _rough(patch, rng, 0.5, 0.95), rng.choice([-1, 1]) * rng.uniform(0.3, 1.0)
    return np.asarray(np.expm1(skew * rough / _HEIGHT) * _HEIGHT / skew)


def _stepped(patch: Patch, rng: np.random.Generator) -> FloatArray:
    rough = _rough(patch, rng, 0.8, 0.8) * rng.uniform(0.1, 0.5)
    (a, b), phase = rng.choice([[1, 0], [1, 1], [2, 1], [1, 3]]), rng.uniform()
    x, y = patch.offsets(np.zeros(2))
    above = np.sin(2 * np.pi * (a * x + b * y + phase)) > 0
    return np.asarray(rough + rng.uniform(0.01, 0.1) * above)


def _spheres(patch: Patch, rng: np.random.Generator) -> FloatArray:
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(1, 6))):
        x, y = patch.offsets(rng.uniform(size=2))
        cap = rng.uniform(0, 0.05) - (x**2 + y**2) / (2 * rng.uniform(0.1, 0.4))
        heights = np.maximum(heights, cap)
    return heights


def _cylinders(patch: Patch, rng: np.random.Generator) -> FloatArray:
    a, b = rng.choice([[1, 0], [1, 1], [2, 1], [0, 2], [3, 1]])
    x, y = patch.offsets(np.zeros(2))
    across = (a * x + b * y + rng.uniform()) % 1 - 0.5
    return np.asarray(-(across**2) / (2 * (a * a + b * b)) * rng.uniform(2, 8))


def _punches(patch: Patch, rng: np.random.Generator) -> FloatArray:
    heights, depth = np.zeros(patch.shape), rng.uniform(0.02, 0.3)
    for _ in range(int(rng.integers(1, 4))):
        x, y = patch.offsets(rng.uniform(size=2))
        size, turn = rng.uniform(0.08, 0.3), rng.uniform(0, np.pi / 2)
        along = x * np.cos(turn) + y * np.sin(turn)
        across = y * np.cos(turn) - x * np.sin(turn)
        if rng.uniform() < 0.6:
            inside = along**2 + (across * rng.uniform(1, 2)) ** 2 <= size**2
        else:
            inside = (np.abs(along) <= 0.8 * size) & (np.abs(across) <= 0.6 * size)
        heights = np.where(inside, depth, heights)
    return heights


def _cones(patch: Patch, rng: np.random.Generator) -> FloatArray:
    x, y = patch.offsets(rng.uniform(size=2))
    flat = rng.uniform(0.1, 0.35)
    return np.asarray(-rng.uniform(0.1, 0.8) * np.maximum(np.hypot(x, y) - flat, 0))


def _dimples(patch: Patch, rng: np.random.Generator) -> FloatArray:
    rough, count = 0.1 * _rough(patch, rng, 0.8, 0.8), int(rng.integers(2, 5))
    x, y = patch.offsets(np.zeros(2))
    u, v = ((count * s + rng.uniform()) % 1 - 0.5 for s in (x, y))
    deep = (rng.uniform(0.2, 0.45) ** 2 - u**2 - v**2) / count**2
    return np.asarray(rough - np.maximum(0, deep / (2 * rng.uniform(0.2, 0.6))))


def _outliers(patch: Patch, rng: np.random.Generator) -> FloatArray:
    heights = _rough(patch, rng, 0.8, 0.8)
    for _ in range(int(rng.integers(3, 30))):
        x, y = patch.offsets(rng.uniform(size=2))
        width, height = rng.uniform(0.003, 0.012), rng.uniform(0.02, 0.2)
        heights = heights + height * np.exp(-(x**2 + y**2) / (2 * width**2))
    return heights


def _sharp(patch: Patch, rng: np.random.Generator) -> FloatArray:
    count, (x, y) = int(rng.integers(1, 4)), patch.offsets(np.zeros(2))
    u, v = ((count * s + rng.uniform()) % 1 - 0.5 for s in (x, y))
    return np.asarray(-rng.uniform(0.3, 1.0) * np.hypot(u, v) / count)


def _honed(patch: Patch, rng: np.random.Generator) -> FloatArray:
    heights = rng.uniform(0.05, 0.3) * _rough(patch, rng, 0.8, 0.8)
    (x, y), width = patch.offsets(np.zeros(2)), rng.uniform(0.05, 0.2)
    for side in (-1, 1):
        a, b = int(rng.integers(1, 4)), side * int(rng.integers(1, 4))
        away = np.abs((2 * (a * x + b * y) + rng.uniform()) % 1 - 0.5)
        heights = heights - 0.7 * np.maximum(width - away, 0) / (2 * math.hypot(a, b))
    return heights


def _quantised(patch: Patch, rng: np.random.Generator) -> FloatArray:
    rough, levels = _rough(patch, rng, 0.5, 0.95), int(rng.integers(6, 41))
    step = 6 * _HEIGHT / levels
    return np.asarray(np.round(rough / step) * step)


#: Heights of each kind on a patch.  Elliptic roughness is the isotropic one on other periods, and
#: oblong is on cells of 2 to 1.
KINDS: dict[str, Maker] = {
    "self-affine": _self_affine,
    "elliptic": _self_affine,
    "oblong": _self_affine,
    "worn": _worn,
    "skewed": _skewed,
    "stepped": _stepped,
    "spheres": _spheres,
    "cylinders": _cylinders,
    "punches": _punches,
    "truncated cones": _cones,
    "dimples": _dimples,
    "outliers": _outliers,
    "sharp cones": _sharp,
    "honed": _honed,
    "quantised": _quantised,
}


@dataclass(frozen=True)
class Member:
    """One surface of an ensemble with its load and hardness.

    `shape` is that of the coarse grid; the maker makes heights on a patch from random numbers of
    the seed `drawn`.
    """

    shape: tuple[int, int]
    periods: tuple[float, float]
    load: float
    hardness: float
    high: int
    maker: Maker
    drawn: int

    def solved(self, factor: int) -> tuple[FloatArray, FloatArray, list[float]]:
        """(pressure, gap, spacing) on a grid `factor` times as fine as the coarse one.

        Raises NotConverged.
        """
        shape = (factor * self.shape[0], factor * self.shape[1])
        patch = Patch(shape, self.periods, self.high)
        heights = self.maker(patch, np.random.default_rng(self.drawn))
        q = rfft_wavenumbers(shape, self.periods)
        q.flat[0] = np.inf
        options = bem.Options(tolerance=1e-7)
        solution = bem.solve_pressure(heights, 2 / q, self.load, self.hardness, options=options)
        gap = solution.displacement + solution.offset - heights
        spacing = [length / n for length, n in zip(self.periods, shape, strict=True)]
        return solution.pressure, gap, spacing

    def areas(self, factor: int) -> tuple[Areas, Areas, Areas]:
        """(raw, corrected, error) on a grid `factor` times as fine as the coarse one."""
        pressure, gap, spacing = self.solved(factor)
        return estimate_areas(pressure, gap, self.hardness, spacing, 1.0)


def member(makers: Mapping[str, Maker], kind: str, seed: int, points: int) -> Member:
    """Draw a member of the ensemble on a coarse grid of about `points` squared."""
    rng = np.random.default_rng([seed, *kind.encode()])
    per_wave = rng.choice([3, 4, 4, 4, 6, 8, 16])
    shape, periods = (points, points), (1.0, 1.0)
    if kind == "elliptic":
        shape, periods = (3 * points // 4, 3 * points // 2), (1.0, 2.0)
    if kind == "oblong":
        shape = (3 * points // 4, 3 * points // 2)
    hardness = 10 ** rng.uniform(-1.3, 0.3) if rng.uniform() < 0.6 else math.inf
    load = min(10 ** rng.uniform(-2.5, 0.3), 0.9 * hardness)
    high = max(int(min(shape) // per_wave), 2)
    return Member(shape, periods, load, hardness, high, makers[kind], int(rng.integers(1 << 31)))


def judged(kind: str, seed: int, points: int) -> list[dict[str, Any]]:
    """Solve one member of the ensemble on a grid of about `points` squared and on the fine one.

    Returns for each part of the area a row: kind, seed, part, exact, error (absolute, of the
    corrected area), claimed and raw_error, all as shares of the nominal area.
    """
    one = member(KINDS, kind, seed, points)
    (raw, corrected, claimed), (_, exact, _) = one.areas(1), one.areas(FINER)
    rows = []
    for part in PARTS if math.isfinite(one.hardness) else ("total",):
        truth = getattr(exact, part)
        figures = {
            "exact": truth,
            "error": abs(getattr(corrected, part) - truth),
            "claimed": getattr(claimed, part),
            "raw_error": abs(getattr(raw, part) - truth),
        }
        rows.append({"kind": kind, "seed": seed, "part": part} | figures)
    return rows


def timed(rows: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """Tabulate rows of `judged` with `times`, error by claimed error.

    Errors of the solver's tolerance are no errors of the estimate, and an area for which neither an
    error nor a claim exists, such as the plastic one where nothing is plastic, is left out.
    """
    table = pd.DataFrame(rows)
    error = (table["error"] - 1e-9).clip(lower=0)
    table = table.assign(times=error / table["claimed"].clip(lower=1e-9))
    return table[(error > 0) | (table["claimed"] > 0)].reset_index(drop=True)


def coverage(table: pd.DataFrame) -> pd.DataFrame:
    """For each kind, the share of areas within their claim, and medians relative to the areas."""
    within = table.groupby("kind", sort=False)["times"].agg(lambda times: (times <= 1).mean())
    large = table[table["exact"] > SMALLEST]
    relative = large[["error", "claimed"]].div(large["exact"], axis=0)
    medians = relative.groupby(large["kind"], sort=False).median().add_prefix("median_")
    return within.rename("within").to_frame().join(medians).reset_index()


def claims_by_errors(table: pd.DataFrame, within: float) -> tuple[float, float]:
    """The median claim divided by the median error, both relative to the areas, and the ideal one.

    The ideal one is that of claims with a factor for each kind, so that the share `within` of each
    kind holds: claims of the same form cannot be better on these surfaces than if they knew their
    kind.  A normal error of known variance has 2.6 at .92.
    """
    factor = table.groupby("kind")["times"].transform(lambda times: times.quantile(within))
    large = table["exact"] > SMALLEST
    relative = table[["error", "claimed"]].div(table["exact"], axis=0)
    error = relative["error"][large].median()
    claims = (relative["claimed"][large], (relative["claimed"] * factor)[large])
    return float(claims[0].median() / error), float(claims[1].median() / error)


@study(
    "areas",
    fast={"seeds": range(100, 104), "points": 32},
    full={"seeds": range(100, 130), "points": 64},
)
def areas(
    say: Say, seeds: Sequence[int], points: int, kinds: Sequence[str] = tuple(KINDS)
) -> Charts:
    """Coverage of the claimed errors of corrected areas, by kind of surface."""
    found = []
    for seed in seeds:
        say(f"seed {seed} of every kind")
        found += [row for kind in kinds for row in judged(kind, seed, points)]
    table = timed(found)
    ranked = table.sort_values("times", kind="stable")
    groups = ranked.groupby("kind")["times"]
    ranked = ranked.assign(share=groups.cumcount().add(1) / groups.transform("size"))
    ranked = ranked.assign(times=ranked["times"].clip(1e-3, 1e2))
    ranked = ranked.sort_values("kind", key=lambda kind: kind.map(list(KINDS).index), kind="stable")
    shares = coverage(table)
    shares[["within", "median_error", "median_claimed"]] *= 100
    form = "{kind} {within:.0f} % ({median_error:.2g}, {median_claimed:.2g})"
    ratio, ideal = claims_by_errors(table, 0.92)
    yield (
        Plot(
            ("times", "error by claimed error (–)"),
            ("share", "share of areas (–)"),
            series=("kind",),
            style="curve",
            log="x",
            upright={"claimed": 1.0},
        ),
        ranked.drop(columns="seed"),
        f"Share of {len(table)} corrected areas (total, plastic and elastic) whose error is at "
        f"most so many times the claimed one, on {len(seeds)} surfaces of each kind, against grids "
        f"{FINER} times as fine.  Loads from .003 to 2 E*, hardness from .05 to 2 E* or none, 3 to "
        f"16 points per shortest wavelength.  Within their claim are "
        f"{100 * (table['times'] <= 1).mean():.0f} %; by kind, with the medians of error and claim "
        f"in % of the area: {listed(shares, form)}.  "
        f"The ratio of the medians of all claims and errors is {ratio:.1f}; it would be "
        f"{ideal:.1f} if each kind had a factor of its own with which 92 % of its claims hold.",
    )
