"""The bank: scenes of many kinds on nested grids, with which the area estimate is
judged.

Each scene is a surface of one of KINDS with a load, a hardness and 3 to 16 points per
shortest wavelength, all drawn by its seed, on grids of 64, 128 and 256 points a side,
and on a reference of 1024.  The unit of pressure is E*, slopes are of order 1.
"unloaded" kinds are solved at a peak load first, and judged at a part of it on the
surface that is left.  "rounded" and "quantised" kinds have heights in steps: the first
is judged by the smooth surface, the second by that of the steps.

`python -m laboratory.area_bank [--seeds 5000:5012] [--keep FOLDER] [KIND ...]` prints
the coverage, the median error and the ratio of claim to error, by kind, in some five
minutes of one core, and the coverage on each grid of surfaces without a note that
claims do not hold for their reading; with `--gaps` the errors of the mean gap, and with
`--ablation` what each mechanism is worth.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.bem.areas import rim_correction as rim
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.kernel import rfft_wavenumbers
from epcontact.errors import NotConverged
from epcontact.results import FloatArray
from epcontact.scene import Surface, rms_slope
from laboratory import areas as study
from laboratory.areas import Maker, Member, by_name, roughness

PARTS = ("total", "plastic", "elastic")
FACTORS, REFERENCE = (1, 2, 4), 16
#: Areas below this share of the nominal area are not judged.
SMALLEST = 1e-3


def _turned(patch, rng):
    """Return heights of feed marks of a lathe: cusps between circular grooves, with
    roughness.

    `patch` is the grid on one period and `rng` a numpy generator; the heights have the
    grid's shape.
    """
    a, b = rng.choice([[3, 0], [0, 4], [2, 3], [5, 1]])
    x, y = patch.offsets()
    across = (a * x + b * y + rng.uniform()) % 1 - 0.5
    cusps = across**2 / (2 * (a * a + b * b)) * rng.uniform(2, 8) * math.hypot(a, b)
    return cusps + rng.uniform(0.02, 0.2) * roughness(patch, rng, 0.8, 0.8)


def _blasted(patch, rng):
    """Return heights (the shape of `patch`) of overlapping random dimples, with ridges
    between them.
    """
    heights, radius = np.zeros(patch.shape), rng.uniform(0.1, 0.25)
    for _ in range(int(rng.integers(40, 120))):
        x, y = patch.offsets(rng.uniform(size=2))
        depth = rng.uniform(0.005, 0.03)
        heights = np.minimum(heights, (x**2 + y**2) / (2 * radius) - depth)
    return heights + rng.uniform(0, 0.1) * roughness(patch, rng, 0.8, 0.8)


def _domed(patch, rng):
    """Return heights (the shape of `patch`) of random bumps and ridges with round tops,
    and slopes beyond an edge around them.
    """
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(1, 5))):
        x, y = patch.offsets(rng.uniform(size=2))
        r, top = np.hypot(x, y * rng.choice([0, 1, 1.5])), rng.uniform(0.08, 0.25)
        radius, slope = 10 ** rng.uniform((-0.3, -1), (1, 0.5))
        heights = np.maximum(
            heights, -(r**2) / 2 / radius - slope * np.maximum(r - top, 0)
        )
    return heights


def _ground(patch, rng):
    """Return roughness on the grid of `patch`, whose waves are many times longer along
    one direction.
    """
    modes, n = np.fft.rfft2(roughness(patch, rng, 0.5, 0.95)), patch.shape[0]
    q = np.fft.fftfreq(n, 1 / n)[:, None]
    return np.fft.irfft2(modes / (1 + (q / rng.uniform(1, 3)) ** 2), patch.shape) * 3


def _copies(patch, rng):
    """Return a texture of equal bumps, with little roughness, on the grid of
    `patch`.
    """
    (x, y), count, shape = patch.offsets(), int(rng.integers(4, 9)), rng.uniform(size=2)
    u, v = ((count * s + o) % 1 - 0.5 for s, o in zip((x, y), shape, strict=True))
    bump = u**2 + v**2 * rng.uniform(1, 3)
    heights = -(bump if rng.uniform() < 0.6 else np.sqrt(bump) / 2) / count
    return heights + rng.choice([0.0, 0.01]) * roughness(patch, rng, 0.8, 0.8)


def _noisy(patch, rng):
    """Return roughness on the grid of `patch` with a fine noise of smaller
    amplitude.
    """
    fine = Member(
        patch.shape, (1.0, 1.0), 0, 0, max(int(1.25 * patch.high), 2), patch.maker, 0
    )
    return roughness(patch, rng, 0.8, 0.8) + 0.2 * roughness(fine, rng, 0.1, 0.1)


def _wear(patch, rng):
    """Return roughness on the grid of `patch`, whose summits are cut off at a random
    height.
    """
    return np.minimum(roughness(patch, rng, 0.5, 0.95), rng.uniform(-0.5, 1.0) * 0.06)


def _rough(patch, rng):
    """Return self-affine roughness on the grid of `patch`, with a random Hurst exponent
    from 0.2 to 0.95.
    """
    return roughness(patch, rng, 0.2, 0.95)


def _line(patch, rng):
    """Return random waves on a line, with `patch.shape[0]` points, whose amplitudes
    fall with a random exponent.
    """
    x = np.arange(patch.shape[0]) / patch.shape[0]
    k = np.arange(1, patch.high + 1)
    heights = k ** -rng.uniform(0.7, 1.5) / 10
    return np.cos(2 * np.pi * (np.outer(x, k) + rng.uniform(size=len(k)))) @ heights


KINDS: dict[str, Maker] = {
    "self-affine": _rough,
    "oblong cells": _rough,
    "layers": _rough,
}
KINDS |= by_name(_noisy, _ground, _turned, _blasted, _copies, _domed) | {"worn": _wear}
KINDS |= {
    kind: study.KINDS[kind] for kind in ("skewed", "spheres", "cylinders", "punches")
}
KINDS |= {kind: study.KINDS[kind] for kind in ("outliers", "sharp cones", "quantised")}
KINDS |= {
    "rounded": _rough,
    "lines": _line,
    "unloaded": _rough,
    "unloaded spheres": study.KINDS["spheres"],
}
KINDS |= {"unloaded worn": _wear, "unloaded lines": _line}


#: Kinds with edges, ridges or steps; those that are neither these nor unloaded are
#: smooth.
SHARP = (
    "turned",
    "blasted",
    "domed",
    "copies",
    "worn",
    "punches",
    "outliers",
    "quantised",
)


@dataclass(frozen=True)
class Scene:
    """One random scene, on which the estimated areas are compared with those of a fine
    grid.

    `kind` is a key of KINDS and `seed` the number of the scene; `member` holds the
    surface and the load over E*; `depth` is that of a sliding layer in periods; `after`
    is the load after unloading over the load before, 1 without unloading.
    """

    kind: str
    seed: int
    member: Member
    depth: float
    after: float

    def surface(self, factor):
        """Return the heights and the periods of this scene on a grid `factor` times as
        fine.

        Both have the unit of the period, which is 1.
        """
        one, rng = self.member, np.random.default_rng(self.member.drawn)
        if self.kind.endswith("lines"):
            shape, periods = (factor * one.shape[0],), one.periods[:1]
        else:
            shape, periods = tuple(factor * n for n in one.shape), one.periods
        heights = np.broadcast_to(one.maker(replace(one, shape=shape), rng), shape)
        if self.kind == "rounded" and factor < REFERENCE:
            step = heights.std() * 10 ** np.random.default_rng(self.seed).uniform(
                -3, -0.5
            )
            heights = np.round(heights / step) * step
        return np.ascontiguousarray(heights), periods

    def told(self, factor):
        """Return whether a note of the surface warns that the error estimates may not
        hold for its rounded or quantised heights.
        """
        notes = " ".join(Surface(*self.surface(factor)).notes)
        words = {
            "rounded": {"for a smooth"},
            "quantised": {"neither for", "not for its steps"},
        }
        return any(said in notes for said in words.get(self.kind, ()))

    def solved(self, factor):
        """Solve the scene on a grid `factor` times as fine.

        Returns pressure, gap, hardness, spacings, modulus (1) and plastic displacement
        (None without unloading); pressures are over E*, lengths over the period. Raises
        NotConverged as the solver does.
        """
        one, (heights, periods) = self.member, self.surface(factor)
        shape = heights.shape
        q = rfft_wavenumbers(shape, periods)
        q.flat[0] = np.inf
        compliance, depth = 2 / q, np.minimum(2 * q * self.depth, 300.0)
        compliance *= (np.cosh(depth) - 1) / (np.sinh(depth) + depth)
        options = bem.Options(tolerance=1e-8)
        found = bem.solve_pressure(
            heights, compliance, one.load, one.hardness, options=options
        )
        gap, flowed = found.gap(heights), None
        if self.after < 1:
            flowed = np.where(found.pressure >= one.hardness, np.maximum(-gap, 0), 0)
            left = heights - flowed
            load = self.after * one.load
            found = bem.solve_pressure(
                left, compliance, load, one.hardness, options=options
            )
            gap = found.gap(left)
        spacing = [length / n for length, n in zip(periods, shape, strict=True)]
        return found.pressure, gap, one.hardness, spacing, 1.0, flowed


def scene(kind, seed, points=64):
    """Draw the random `Scene` of a kind and a seed, on `points` grid points a side."""
    rng = np.random.default_rng([seed, *kind.encode()])
    per_wave = rng.choice([3, 4, 4, 4, 6, 8, 16])
    shape = (points, points)
    if kind == "oblong cells":
        shape = (3 * points // 4, 3 * points // 2)
    hardness = math.inf
    if rng.uniform() < 0.6:
        hardness = 10 ** rng.uniform(-1.0, 0.1)
    load, after = 10 ** rng.uniform(-2.2, 0.0), 1.0
    if kind.startswith("unloaded"):
        hardness, after = 10 ** rng.uniform(-1.0, 0.08), 10 ** rng.uniform(-1.7, 0.0)
        load = hardness * 10 ** rng.uniform(-2, -0.3)
    load = min(load, 0.7 * hardness)
    depth = 1e3  # as good as a half-space
    if kind == "layers":
        depth = 10 ** rng.uniform(-1.5, -0.5)
    high, drawn = max(int(min(shape) // per_wave), 2), int(rng.integers(1 << 31))
    one = Member(shape, (1.0, 1.0), load, hardness, high, KINDS[kind], drawn)
    return Scene(kind, seed, one, depth, after)


def kept(folder: Path | None, one: Scene, factor: int):
    """Return `Scene.solved(factor)`, read from the folder if it was saved there, and
    else solved and saved.

    Without a folder (None) nothing is saved.
    """
    path = folder and folder / f"{one.kind.replace(' ', '-')}-{one.seed}-{factor}.npz"
    if path and path.exists():
        with np.load(path) as found:
            arrays = [found[name] for name in ("pressure", "gap", "flowed")]
            hardness, spacing = float(found["hardness"]), found["spacing"].tolist()
        return (
            *arrays[:2],
            hardness,
            spacing,
            1.0,
            arrays[2] if arrays[2].size else None,
        )
    solved = p, g, hardness, spacing, _, flowed = one.solved(factor)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        w = np.zeros(0) if flowed is None else flowed
        np.savez(path, pressure=p, gap=g, hardness=hardness, spacing=spacing, flowed=w)
    return solved


def reference(folder: Path | None, one: Scene) -> FloatArray:
    """Return the total, plastic and elastic area fractions on the reference grid (3,),
    read from the folder or solved and saved there.
    """
    path = folder and folder / f"{one.kind.replace(' ', '-')}-{one.seed}.txt"
    if path and path.exists():
        return np.loadtxt(path)
    found = estimated(
        *one.solved(REFERENCE * (4 if one.kind.endswith("lines") else 1))
    )[1]
    exact = np.array([getattr(found, part) for part in PARTS])
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, exact)
    return exact


def estimated(pressure, gap, hardness, spacing, modulus, flowed):
    """Return the raw areas, the corrected areas and their estimated errors of a
    solution.

    The arguments are the values that `Scene.solved` returns.
    """
    return estimate_areas(pressure, gap, hardness, spacing, modulus, flowed=flowed)


def judged(kinds, seeds, folder=None, factors=FACTORS):
    """Return a table with a row for each scene, grid and part of the area.

    The columns are the exact area, the corrected area (`found`), its estimated error
    (`claimed`), its error, whether the error is within the estimate, and whether a note
    warns (`told`).

    `folder` saves solutions, and `factors` are the refinements of the grid. A scene
    that does not converge is printed and left out.
    """
    rows = []
    for kind in kinds:
        for seed in seeds:
            one = scene(kind, seed)
            try:
                exact = reference(folder, one)
                grids = [(factor, kept(folder, one, factor)) for factor in factors]
            except NotConverged as why:
                print(kind, seed, why)
                continue
            for factor, solution in grids:
                _, found, error = estimated(*solution)
                told = kind in ("rounded", "quantised") and one.told(factor)
                row = {"kind": kind, "seed": seed, "grid": factor, "told": told}
                flows = math.isfinite(one.member.hardness) and one.after == 1
                for part, truth in zip(
                    PARTS if flows else PARTS[:1], exact, strict=False
                ):
                    areas = {
                        "found": getattr(found, part),
                        "claimed": getattr(error, part),
                    }
                    rows.append(row | areas | {"part": part, "exact": truth})
    table = pd.DataFrame(rows)
    table["error"] = (table.found - table.exact).abs()
    table["within"] = table.error <= table.claimed + 1e-7
    return table


def gaps(kinds, seeds):
    """Return the 90 % quantile, by kind, of the mean gap's relative error and of its
    error over the estimate.

    The last two rows are the median and the 90 % quantile of all kinds.
    """
    rows = []
    for one in (
        scene(kind, seed) for kind in kinds for seed in seeds if "lines" not in kind
    ):
        opened = [float(np.maximum(one.solved(n)[1], 0).mean()) for n in (1, 8)]
        solution, heights = one.solved(1), one.surface(1)[0]
        raw, found, error = (a.total for a in estimated(*solution))
        step = rms_slope(heights, solution[3]) * max(solution[3])
        claim, off = step * (abs(raw - found) + error) / raw, abs(opened[0] - opened[1])
        relative = off / (opened[1] or math.nan)
        rows.append({"kind": one.kind, "relative": relative, "times": off / claim})
    table = pd.DataFrame(rows)
    every = table[["relative", "times"]].quantile([0.5, 0.9])
    return pd.concat([table.groupby("kind", sort=False).quantile(0.9), every])


def summary(table):
    """Return statistics by kind of a table of `judged`.

    The columns are the number of areas, the percentage within the estimate, medians of
    error and estimate in % of the exact area, their ratio, the factor (`need`) that
    would cover 90 %, and the mean signed error.
    """
    large = table[table.exact > SMALLEST].copy()
    for name in ("error", "claimed"):
        large[name] *= 100 / large.exact
    large["times"] = large.error / large.claimed.clip(1e-5)
    large["signed"] = (100 * (large.found / large.exact - 1)).clip(-50, 50)
    groups = large.groupby("kind", sort=False)
    out = pd.DataFrame({"n": groups.size(), "cover": 100 * groups.within.mean()})
    out = out.join(groups[["error", "claimed"]].median())
    out["ratio"], out["need"] = out.claimed / out.error, groups.times.quantile(0.9)
    return out.assign(mean=groups.signed.mean())


def without():
    """Return the names of the area correction's module to replace, and their
    replacements, for each mechanism that an ablation switches off.
    """
    whole = rim.sums_of_fronts

    def lacking(*names):
        """Return the replacement of an ablation in which the named sums over the
        contact's boundary are 0.
        """

        def sums(*arguments):
            """Return the sums over the contact's boundary with the named ones set to
            0.
            """
            found, *rest = whole(*arguments)
            return found._replace(**dict.fromkeys(names, np.zeros(2))), *rest

        return {"sums_of_fronts": sums}

    return {
        "nothing": {"TIP": rim.TIP},
        "offsets of strips": {"OFFSETS": np.full_like(rim.OFFSETS, rim.OFFSETS[-1])},
        "corner": {"CORNER": 0.0},
        "tips": {"TIP": 0.0},
        "harmonic": {"HARMONIC": 0.0},
        "oblong": {"OBLONG": 0.0},
        "load": {"_balance": lambda areas, covariance, *_: (areas, covariance)},
        "zones": lacking("hidden_zone"),
        "hidden gaps": lacking("gap_squares", "crease_area"),
        "doubt": lacking("uncertainty", "scatter"),
        "claims of kinks": lacking("at_kink"),
        "copies": {"copies": lambda pressure: 1},
    }


def ablation(kinds, seeds, folder):
    """Return the median error (%) and the coverage (%) by group of kinds, with one row
    for each mechanism that is switched off.
    """
    judged(kinds, seeds, folder, (1,))  # references and solutions, with all of it
    groups, rows = dict.fromkeys(SHARP, "sharp"), {}
    groups |= {kind: kind.split()[0] for kind in kinds if kind.startswith("unloaded")}
    for name, changed in without().items():
        with mock.patch.multiple(rim, **changed):
            table = judged(kinds, seeds, folder, (1,))
        table = table[table.exact > SMALLEST]
        by = table.assign(
            relative=100 * table.error / table.exact, cover=100.0 * table.within
        )
        by = by.groupby(by.kind.map(groups).fillna("smooth"))
        median, cover = by.relative.median().add_prefix("error, "), by.cover.mean()
        rows[name] = pd.concat([median, cover.add_prefix("cover, ")])
    return pd.DataFrame(rows).T


def main():
    """Print the statistics of the coarsest grid, and by kind and grid the percentage of
    errors within the estimate.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--seeds", default="5000:5012")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--gaps", action="store_true", help="of the mean gap instead")
    parser.add_argument(
        "--ablation", action="store_true", help="what each mechanism is worth"
    )
    given = parser.parse_args()
    if given.ablation and not given.keep:
        given.keep = Path(tempfile.mkdtemp())
    seeds = range(*map(int, given.seeds.split(":")))
    if given.gaps:
        print(gaps(given.kinds or list(KINDS), seeds).round(4).to_string())
        return
    if given.ablation:
        print(
            ablation(given.kinds or list(KINDS), seeds, given.keep).round(2).to_string()
        )
        return
    table = judged(given.kinds or list(KINDS), seeds, given.keep)
    print(summary(table[table.grid == 1]).round(2).to_string())
    plain = table[(table.exact > SMALLEST) & ~table.told]
    cover = plain.pivot_table("within", "kind", "grid", sort=False)
    print((100 * cover).round(1).to_string())


if __name__ == "__main__":
    main()
