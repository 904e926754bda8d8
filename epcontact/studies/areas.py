"""Are the claimed errors of corrected areas true?  An ensemble of many kinds of
surfaces.

Each member of the ensemble is a surface of one of KINDS with a load, a hardness and a
number of points per shortest wavelength, all drawn by its seed.  Its reference is the
corrected area on a grid FINER times as fine.  The unit of pressure is E* and the slopes
of most kinds are of order 1. The constants of the claims come from other seeds and
scenes (`laboratory.area_bank`).
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
from epcontact.output.charts.plot import Plot
from epcontact.results import Areas, FloatArray
from epcontact.scene import Body, Material
from epcontact.studies.frame import Charts, Ints, Rows, Say, rows, study
from epcontact.studies.paper_scene import PARTS, self_affine

#: The reference has so many points for each point of the coarse grid along a direction.
FINER = 8
_HEIGHT = 0.06  # about the rms height of the rough kinds
Random = np.random.Generator


#: Makes heights of a kind on a patch, the grid of a `Member` or a finer one.
Maker = Callable[[Any, Random], Any]


def named(*makers: Any) -> dict[str, Maker]:
    """Makers by their names in words."""
    return {maker.__name__.replace("_", " ").strip(): maker for maker in makers}


def roughness(patch: Member, rng: Random, low: float, high: float) -> Any:
    """Self-affine roughness of rms slope 1; its Hurst exponent is drawn between two
    numbers.
    """
    hurst, seed = rng.uniform(low, high), int(rng.integers(1 << 31))
    return self_affine(
        2 * math.pi, patch.shape, seed, patch.high, roll_off=2, hurst=hurst
    ).heights


def _worn(patch: Member, rng: Random) -> Any:
    return np.minimum(
        roughness(patch, rng, 0.5, 0.95), rng.uniform(-0.2, 0.8) * _HEIGHT
    )


def _skewed(patch: Member, rng: Random) -> Any:
    rough, skew = (
        roughness(patch, rng, 0.5, 0.95),
        rng.choice([-1, 1]) * rng.uniform(0.3, 1.0),
    )
    return np.expm1(skew * rough / _HEIGHT) * _HEIGHT / skew


def _stepped(patch: Member, rng: Random) -> Any:
    rough = roughness(patch, rng, 0.8, 0.8) * rng.uniform(0.1, 0.5)
    (a, b), phase = rng.choice([[1, 0], [1, 1], [2, 1], [1, 3]]), rng.uniform()
    x, y = patch.offsets()
    above = np.sin(2 * np.pi * (a * x + b * y + phase)) > 0
    return rough + rng.uniform(0.01, 0.1) * above


def _spheres(patch: Member, rng: Random) -> Any:
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(1, 6))):
        x, y = patch.offsets(rng.uniform(size=2))
        cap = rng.uniform(0, 0.05) - (x**2 + y**2) / (2 * rng.uniform(0.1, 0.4))
        heights = np.maximum(heights, cap)
    return heights


def _cylinders(patch: Member, rng: Random) -> Any:
    a, b = rng.choice([[1, 0], [1, 1], [2, 1], [0, 2], [3, 1]])
    x, y = patch.offsets()
    across = (a * x + b * y + rng.uniform()) % 1 - 0.5
    return -(across**2) / (2 * (a * a + b * b)) * rng.uniform(2, 8)


def _punches(patch: Member, rng: Random) -> Any:
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


def _truncated_cones(patch: Member, rng: Random) -> Any:
    x, y = patch.offsets(rng.uniform(size=2))
    flat = rng.uniform(0.1, 0.35)
    return -rng.uniform(0.1, 0.8) * np.maximum(np.hypot(x, y) - flat, 0)


def _dimples(patch: Member, rng: Random) -> Any:
    rough, count = 0.1 * roughness(patch, rng, 0.8, 0.8), int(rng.integers(2, 5))
    x, y = patch.offsets()
    u, v = ((count * s + rng.uniform()) % 1 - 0.5 for s in (x, y))
    deep = (rng.uniform(0.2, 0.45) ** 2 - u**2 - v**2) / count**2
    return rough - np.maximum(0, deep / (2 * rng.uniform(0.2, 0.6)))


def _outliers(patch: Member, rng: Random) -> Any:
    heights = roughness(patch, rng, 0.8, 0.8)
    for _ in range(int(rng.integers(3, 30))):
        x, y = patch.offsets(rng.uniform(size=2))
        width, height = rng.uniform(0.003, 0.012), rng.uniform(0.02, 0.2)
        heights = heights + height * np.exp(-(x**2 + y**2) / (2 * width**2))
    return heights


def _sharp_cones(patch: Member, rng: Random) -> Any:
    count, (x, y) = int(rng.integers(1, 4)), patch.offsets()
    u, v = ((count * s + rng.uniform()) % 1 - 0.5 for s in (x, y))
    return -rng.uniform(0.3, 1.0) * np.hypot(u, v) / count


def _honed(patch: Member, rng: Random) -> Any:
    heights = rng.uniform(0.05, 0.3) * roughness(patch, rng, 0.8, 0.8)
    (x, y), width = patch.offsets(), rng.uniform(0.05, 0.2)
    for side in (-1, 1):
        a, b = int(rng.integers(1, 4)), side * int(rng.integers(1, 4))
        away = np.abs((2 * (a * x + b * y) + rng.uniform()) % 1 - 0.5)
        heights = heights - 0.7 * np.maximum(width - away, 0) / (2 * math.hypot(a, b))
    return heights


def _quantised(patch: Member, rng: Random) -> Any:
    rough, levels = roughness(patch, rng, 0.5, 0.95), int(rng.integers(6, 41))
    step = 6 * _HEIGHT / levels
    return np.round(rough / step) * step


#: Heights of each kind on a patch.  Elliptic roughness is the isotropic one on other
#: periods, and oblong is on cells of 2 to 1.
KINDS: dict[str, Maker] = dict.fromkeys(
    ("self-affine", "elliptic", "oblong"), partial(roughness, low=0.2, high=0.95)
)
KINDS |= named(
    _worn, _skewed, _stepped, _spheres, _cylinders, _punches, _truncated_cones
)
KINDS |= named(_dimples, _outliers, _sharp_cones, _honed, _quantised)


@dataclass(frozen=True)
class Member:
    """One surface of an ensemble on a grid of `shape`, with its load and hardness.

    high: shortest waves per period of the rough kinds.  The maker makes heights from
    random numbers of the seed `drawn`.
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
        """(nx, 1) and (1, ny) distances from the nearest image of a centre."""
        x, y = (
            (np.arange(n) * (length / n) - c + length / 2) % length - length / 2
            for n, c, length in zip(self.shape, centre, self.periods, strict=True)
        )
        return x[:, None], y[None, :]

    def solved(
        self, factor: int
    ) -> tuple[FloatArray, FloatArray, float, list[float], float]:
        """A `solution` on a grid `factor` times as fine; raises NotConverged."""
        fine = replace(self, shape=(factor * self.shape[0], factor * self.shape[1]))
        heights = self.maker(fine, np.random.default_rng(self.drawn))
        return solution(heights, self.load, self.hardness, self.periods)

    def areas(self, factor: int) -> tuple[Areas, Areas, Areas]:
        """(raw, corrected, error) on a grid `factor` times as fine as the coarse
        one.
        """
        return estimate_areas(*self.solved(factor))


def solution(
    heights: FloatArray,
    load: float,
    hardness: float = math.inf,
    periods: tuple[float, ...] | None = None,
) -> tuple[FloatArray, FloatArray, float, list[float], float]:
    """Arguments of `estimate_areas` with E* = 1, on periods of 1 unless they are
    given.
    """
    periods = periods or (1.0,) * heights.ndim
    q = rfft_wavenumbers(heights.shape, periods)
    compliance = surface_compliance(q, Body(), Material(1.0, 0.0))
    options = bem.Options(tolerance=1e-7)
    found = bem.solve_pressure(heights, compliance, load, hardness, options=options)
    spacing = [length / n for length, n in zip(periods, heights.shape, strict=True)]
    return found.pressure, found.gap(heights), hardness, spacing, 1.0


def member(makers: Mapping[str, Maker], kind: str, seed: int, points: int) -> Member:
    """Draw a member of the ensemble on a coarse grid of about `points` squared."""
    rng = np.random.default_rng([seed, *kind.encode()])
    per_wave = rng.choice([3, 4, 4, 4, 6, 8, 16])
    stretched = kind in ("elliptic", "oblong")
    shape = (3 * points // 4, 3 * points // 2) if stretched else (points, points)
    hardness = 10 ** rng.uniform(-1.3, 0.3) if rng.uniform() < 0.6 else math.inf
    load = min(10 ** rng.uniform(-2.5, 0.3), 0.9 * hardness)
    high = max(int(min(shape) // per_wave), 2)
    periods = (1.0, 2.0 if kind == "elliptic" else 1.0)
    return Member(
        shape, periods, load, hardness, high, makers[kind], int(rng.integers(1 << 31))
    )


def judged(kind: str, seed: int, points: int) -> Rows:
    """The part and times, the error by the claim beyond the solver's tolerance, of each
    area of a member that has either; the truth is that of the fine grid.
    """
    one, found = member(KINDS, kind, seed, points), []
    (_, corrected, claimed), (_, exact, _) = one.areas(1), one.areas(FINER)
    for part in PARTS if math.isfinite(one.hardness) else ("total",):
        truth, area, claim = (
            getattr(areas, part) for areas in (exact, corrected, claimed)
        )
        error = max(abs(area - truth) - 1e-9, 0.0)
        if error > 0 or claim > 0:
            found.append({"part": part, "times": error / max(claim, 1e-9)})
    return found


@study("areas", seeds=range(100, 130), points=64)
def areas(
    say: Say,
    seeds: Ints = range(100, 104),
    points: int = 32,
    kinds: Sequence[str] = tuple(KINDS),
) -> Charts:
    """Coverage of the claimed errors of corrected areas, by kind of surface.

    Each mark is an area, at .001 or 100 if beyond; the truth is a grid 8 times as fine.
    Loads are .003 to 2 E*, the hardness .05 to 2 E* or none, with 3 to 16 points a
    shortest wave.
    """
    table = rows(say, judged, seed=seeds, kind=kinds, points=[points])
    table["times"] = table["times"].clip(1e-3, 1e2)
    within = table["times"] <= 1
    shares = within.groupby(table["kind"], sort=False).mean()[::-1]
    kinds, names = (
        list(shares.index),
        [f"{kind}, {share:.0%}" for kind, share in shares.items()],
    )
    table["row"], table["one"] = table["kind"].map(kinds.index), "look"
    x, y = (
        ("times", "error by claimed error (–)"),
        ("row", "kind, share within its claim (–)"),
    )
    limits = {
        "yticks": range(len(names)),
        "yticklabels": names,
        "ylim": (-0.7, len(names)),
    }
    look: Any = {
        "labels": dict.fromkeys(kinds, "_"),
        "upright": {"claimed": 1.0},
        "limits": limits,
    }
    plot = Plot(x, y, ("kind",), style="open", colour="one", log="x", **look)
    told = f"Of {len(table)} areas {within.mean():.0%} are within their claim"
    yield plot, table.drop(columns="seed"), told
