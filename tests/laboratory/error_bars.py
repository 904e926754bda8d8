"""Fit the constant of the claimed errors of corrected areas, `rim_correction.EDGES`.

The ensemble is the bank of scenes (`area_bank`) on its nested grids, but for quantised heights,
with seeds other than those that judge it.  The fit minimises the mean of ln(claim) + max(0,
ln(error/claim))/(1 - COVERED), whose minimum for a single claim is that quantile of the errors, and
in which errors of all sizes and kinds count alike.

`python -m laboratory.error_bars` prints the constant, in some ten minutes of one core (one with
`--keep FOLDER` and the bank's solutions in it).  The second half of the ensemble, fitted alone,
shows how well it determines it: the loss of all is flat near its least value.
"""

from __future__ import annotations

import argparse
import itertools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from epcontact.bem.areas import rim_correction as rim
from epcontact.bem.areas.grid import Sums
from epcontact.bem.areas.rim_correction import EDGES, TIP
from epcontact.errors import NotConverged
from epcontact.studies.areas import named
from laboratory import area_bank

#: The share of errors that are to lie within their claim; on unseen seeds nine of ten then do.
COVERED = 0.94
#: Errors and claims below this number of cells count as this number.
_CELLS = 0.02


def _waves(patch, rng, count=60):
    """Random waves of half to all of the highest wave number, of rms slope 1."""
    (nx, ny), (x, y) = patch.shape, patch.offsets()
    heights, slope = np.zeros((nx, ny)), 0.0
    for _ in range(count):
        size, turn, phase = rng.uniform(0.5, 1), rng.uniform(0, 2 * np.pi), rng.uniform()
        a, b = (round(patch.high * size * f(turn)) for f in (math.cos, math.sin))
        heights += np.cos(2 * np.pi * (a * x + b * y + phase))
        slope += 2 * np.pi**2 * (a * a + b * b)
    return heights / math.sqrt(slope)


def _terraces(patch, rng):
    coarse = replace(patch, high=3)
    above = _waves(coarse, rng) > rng.uniform(-0.05, 0.05)
    return rng.uniform(0.1, 0.5) * _waves(patch, rng) + rng.uniform(0.01, 0.1) * above


def _ripples(patch, rng):
    x, y = patch.offsets()
    heights = np.zeros(patch.shape)
    for slope in (1.0, rng.choice([0.0, 0.3, 1.0])):
        a, b = rng.choice([[1, 0], [0, 3], [1, 2], [2, 2], [4, 1]])
        wave = np.cos(2 * np.pi * (a * x + b * y + rng.uniform()))
        heights = heights + slope * wave / (2 * np.pi * math.hypot(a, b))
    return heights


def _ellipsoids(patch, rng):
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(2, 7))):
        along, across = _turned(patch, rng)
        bent = along**2 * rng.uniform(1, 5) + across**2 * rng.uniform(1, 5)
        heights = np.maximum(heights, rng.uniform(0, 0.04) - bent)
    return heights


def _rings(patch, rng):
    heights = np.zeros(patch.shape)
    for _ in range(int(rng.integers(1, 3))):
        along, across = _turned(patch, rng)
        outer, depth = rng.uniform(0.15, 0.3), rng.uniform(0.02, 0.3)
        away = np.hypot(along, across * rng.uniform(1, 1.5))
        ring = (away < outer) & (away > outer * rng.choice([0.0, rng.uniform(0.3, 0.7)]))
        heights = np.where(ring, depth, heights)
    return heights


def _pyramids(patch, rng):
    along, across = _turned(patch, rng)
    away = np.maximum(np.abs(along), np.abs(across) * rng.uniform(0.7, 1.5))
    return -rng.uniform(0.1, 0.8) * np.maximum(away - rng.uniform(0.05, 0.3), 0)


def _grooves(patch, rng):
    (a, b), (x, y) = rng.choice([[2, 0], [1, 2], [3, 3], [0, 4]]), patch.offsets()
    across = np.abs((a * x + b * y + rng.uniform()) % 1 - 0.5)
    width = rng.uniform(0.1, 0.4)
    depth = rng.uniform(0.2, 1) * np.maximum(width - across, 0) / math.hypot(a, b)
    return 0.1 * _waves(patch, rng) - depth


def _spikes(patch, rng):
    heights = _waves(patch, rng)
    for _ in range(int(rng.integers(3, 30))):
        along, across = _turned(patch, rng)
        height, slope = rng.uniform(0.02, 0.1), rng.uniform(2, 8)
        heights = heights + np.maximum(height - slope * np.hypot(along, across), 0)
    return heights


def _lapped(patch, rng):
    """Waves whose heights above a level are pressed together, so that the level is an edge."""
    heights = _waves(patch, rng)
    level = rng.uniform(0, 1.5) * heights.std()
    return np.minimum(heights, level + rng.uniform() * (heights - level))


def _turned(patch, rng):
    """Distances (nx, ny) from a random centre along two random directions at right angles."""
    (x, y), turn = patch.offsets(rng.uniform(size=2)), rng.uniform(0, np.pi)
    cosine, sine = math.cos(turn), math.sin(turn)
    return x * cosine + y * sine, y * cosine - x * sine


#: Kinds of surfaces other than those of `epcontact.studies.areas`.
KINDS = {"waves": _waves, "oblong": _waves} | named(_terraces, _ripples, _ellipsoids, _rings)
KINDS |= named(_pyramids, _grooves, _spikes, _lapped)


@dataclass(frozen=True)
class Lesson:
    """Arguments of `rim_correction.areas_of_sums` for one solution, and its areas on a fine one."""

    sums: Sums
    share: float
    cells: float
    aspect: float
    exact: dict[str, float]
    parts: tuple[str, ...]


def lessons(kinds, seeds, folder=None, factors=area_bank.FACTORS):
    """Solve scenes of the bank on its grids; nothing can flow after unloading."""
    out = []
    for kind, seed in itertools.product(kinds, seeds):
        one = area_bank.scene(kind, seed)
        try:
            exact = dict(zip(area_bank.PARTS, area_bank.reference(folder, one), strict=True))
            solutions = [area_bank.kept(folder, one, factor) for factor in factors]
        except NotConverged:
            continue
        flows = math.isfinite(one.member.hardness) and one.after == 1
        for solution in solutions:
            summed = rim.sums_of_fronts(*solution[:5], flowed=solution[5])
            out.append(Lesson(*summed, exact, area_bank.PARTS if flows else ("total",)))
    return out


def fitted_tip(known):
    """Cells that each tip needs: the median over surfaces, those with more tips counting more."""
    needs, weights = [], []
    for one in known:
        located = rim.located_areas(one.sums, rim.OBLONG * math.log(one.aspect) ** 2)
        located += (-1, 1) * (one.sums.zone[::-1] + one.sums.crease)
        off = (located - np.array([one.exact["total"], one.exact["plastic"]]) * one.cells) * (1, -1)
        tips, length = one.sums.tips, one.sums.length + one.sums.shared
        shown = tips > 0
        needs += (TIP + off[shown] / tips[shown]).tolist()
        weights += (tips[shown] / np.sqrt(length[shown])).tolist()
    order = np.argsort(needs)
    share = np.cumsum(np.array(weights)[order])
    return float(np.array(needs)[order][np.searchsorted(share, share[-1] / 2)])


def errors_and_claims(known, edges):
    """(areas, 2): error and claim in cells of each part of the area of each surface."""
    out = []
    for one in known:
        found, claim = rim.areas_of_sums(one.sums, one.share, one.cells, one.aspect, edges)
        for part in one.parts:
            off = abs(getattr(found, part) - one.exact[part])
            out.append([off * one.cells, getattr(claim, part) * one.cells])
    return np.maximum(np.array(out), _CELLS)


def loss(known, edges):
    """The mean of ln(claim) + max(0, ln(error/claim))/(1 - COVERED)."""
    error, claim = np.log(errors_and_claims(known, edges)).T
    return float(np.mean(claim + np.maximum(error - claim, 0) / (1 - COVERED)))


def fitted(known):
    """The constant with the least loss."""
    least = minimize_scalar(lambda log: loss(known, math.exp(log)), (-4, -2), tol=0.02)
    return math.exp(least.x)


def main():
    """Print coverage, loss and constant: in use, of the ensemble and of its second half."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--keep", type=Path)
    kinds = [kind for kind in area_bank.KINDS if kind not in ("quantised", "rounded")]
    known = lessons(kinds, range(5000, 5016), parser.parse_args().keep)
    fits = [fitted(part) for part in (known, known[1::2])]
    print("tip", round(fitted_tip(known), 3), "in use", TIP)
    for name, edges in zip(("in use", "fitted", "half"), (EDGES, *fits), strict=True):
        error, claim = errors_and_claims(known, edges).T
        print(name, *np.round([np.mean(error <= claim), loss(known, edges), edges], 3))


if __name__ == "__main__":
    main()
