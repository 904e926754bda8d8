"""Corrected areas of scenes that once were wrong and sure of it.

`SCENES` are those in which users found the corrected area far from the truth and the
claimed error smaller still; each says what was off then.  References are finer grids,
E* is 1 and so is the period.  The study `resolution` has the errors on resolved
roughness.

`python -m laboratory.area_scenes` prints the table, in some three minutes of one core.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from epcontact.studies.paper_scene import PARTS
from laboratory.areas import FINER, Member, roughness


def _posts(patch, rng, count, width, slope):
    """Return heights of `count` square posts, of a cell's width, on roughness of an rms
    slope.

    `patch` is the grid, `rng` a numpy generator and `width` the width over the period.
    """
    heights = slope * roughness(patch, rng, 0.8, 0.8)
    for _ in range(count):
        cell = (np.floor(rng.uniform(size=2) / width) + 0.5) * width
        x, y = patch.offsets(cell - 0.5 / np.array(patch.shape))
        post = np.maximum(np.abs(x), np.abs(y)) < width / 2
        heights = heights + post * (1.0 if count == 1 else rng.uniform(0.02, 0.1))
    return heights


def _disc(patch, rng, slope):
    """Return heights of a plateau of radius 1/4 with flanks of a slope or, for an
    infinite slope, a step of 1/2.

    Lengths are over the period; `patch` is the grid.
    """
    beyond = np.hypot(*patch.offsets((0.503, 0.4988))) - 0.25
    return -slope * np.maximum(beyond, 0) if slope < np.inf else -0.5 * (beyond > 0)


def _strip(patch, rng):
    """Return heights of a flat strip along x, 0.402 periods wide, on a floor one period
    below.
    """
    x, y = patch.offsets((0.5, 0.5))
    return np.where(np.abs(y) < 0.201, 0.0, -1.0) + 0 * x


def _worn(patch, rng):
    """Return roughness on the grid of `patch`, cut off at 0.4 of its rms height."""
    rough = roughness(patch, rng, 0.8, 0.8)
    return np.minimum(rough, 0.4 * rough.std())


@dataclass(frozen=True)
class Scene:
    """A surface under a load whose areas were once wrong.

    `was` states the error that was reported for each part of the area; `finer` is the
    refinement of the reference grid.
    """

    name: str
    was: dict[str, str]
    member: Member
    finer: int = FINER


def _member(maker, points, load, hardness=math.inf, high=16):
    """Return a `Member` on a grid; load and hardness are over E*.

    `high` is the number of the shortest waves in a period.
    """
    shape = points if isinstance(points, tuple) else (points, points)
    return Member(shape, (1.0, 1.0), load, hardness, high, maker, drawn=1)


_peak = partial(_posts, count=1, width=1 / 64, slope=0.0)
_outliers = partial(_posts, count=42, width=1 / 256, slope=0.02)
_punch, _cone = partial(_disc, slope=np.inf), partial(_disc, slope=0.5)
_hurst_3, _hurst_5, _hurst_8 = (
    partial(roughness, low=h, high=h) for h in (0.3, 0.5, 0.8)
)
_LIGHT = {"total": "-1.85 % (1.87)", "plastic": "-2.3 %"}
_HEAVY = {"total": "-.98 % (1.2)", "plastic": "-1.7 %"}
#: The errors that users found, and the claims beside them.
SCENES = (
    Scene("one peak, p0 1", {"total": "-30 % (.001)"}, _member(_peak, 64, 1.0, 5.0)),
    Scene(
        "one peak, p0 4.5",
        {"plastic": "1700 times (1.04)"},
        _member(_peak, 64, 4.5, 5.0),
    ),
    Scene(
        "42 outliers",
        {"total": "-24 % (.006)"},
        _member(_outliers, 256, 0.05, 0.6, 8),
        4,
    ),
    Scene("disc punch, 128", {"total": "-7.6 %"}, _member(_punch, 128, 0.05), 4),
    Scene("disc punch, 256", {"total": "-3.9 %"}, _member(_punch, 256, 0.05), 4),
    Scene("strip punch", {"total": "-4.5 %"}, _member(_strip, 96, 0.05), 4),
    Scene("cone, slope .5", {"total": "11 times claimed"}, _member(_cone, 48, 0.03)),
    Scene("worn plateaus", {"plastic": "-42 % (4.4)"}, _member(_worn, 64, 0.1, 0.6)),
    Scene("Hurst .3, p0 .01", _LIGHT, _member(_hurst_3, 64, 0.01, 0.6)),
    Scene("Hurst .3, p0 .05", _HEAVY, _member(_hurst_3, 64, 0.05, 0.6)),
    Scene(
        "dx = 2 dy",
        {"plastic": "-3.5 % (2.5)"},
        _member(_hurst_8, (64, 128), 0.05, 0.6),
    ),
    Scene(
        "Hurst .3, soft",
        {"elastic": "-4.2 % (11-17)"},
        _member(_hurst_3, 64, 0.05, 0.3),
    ),
)


def judged(scenes, seeds=range(1, 6)):
    """Return a table of the present errors of the areas that were wrong, in % of the
    exact area.

    Each row is a scene and a part of the area, over seeds of the surface. Columns:
    `was` (the reported error), `now` (mean signed error), `claimed` (median estimate),
    `times` (the largest error over its estimate) and `raw` (mean signed error of the
    counted area).
    """
    rows = []
    for scene in scenes:
        maker = scene.member.maker
        random = maker is _worn or getattr(maker, "func", None) is roughness
        members = [
            replace(scene.member, drawn=seed) for seed in (seeds if random else (1,))
        ]
        found = [(*one.areas(1), one.areas(scene.finer)[1]) for one in members]
        for part, was in scene.was.items():
            raw, now, claimed, exact = np.array(
                [[getattr(areas, part) for areas in one] for one in found]
            ).T
            row = {"scene": scene.name, "part": part, "was (claimed)": was}
            row["now"] = 100 * np.mean(now / exact - 1)
            row["claimed"] = 100 * np.median(claimed / exact)
            row["times"] = np.max(np.abs(now - exact) / claimed)
            rows.append(row | {"raw": 100 * np.mean(raw / exact - 1)})
    return pd.DataFrame(rows)


#: Largest rms errors in % of the total, plastic and elastic area at four points per
#: shortest wave.
AIMS = {64: (0.6, 1.0, 2.0), 128: (0.3, 0.5, 1.0)}


def aims(points, seeds=range(1, 5), finer=FINER):
    """Return rms errors of the areas in %, by hardness and load, and the percentage of
    errors within their estimates.

    The surfaces are rough with Hurst exponents 0.8 and 0.5 and four points a shortest
    wave; `points` is the number a side, and `finer` the refinement of the reference.
    """
    rows = []
    for hardness, share in itertools.product((math.inf, 0.6, 0.3), (0.05, 0.1, 0.3)):
        found, claims = [], []
        load = share if math.isinf(hardness) else min(share, 0.5 * hardness)
        for maker, seed in itertools.product((_hurst_8, _hurst_5), seeds):
            one = Member(
                (points, points), (1.0, 1.0), load, hardness, points // 4, maker, seed
            )
            exact, (_, area, claim) = one.areas(finer)[1], one.areas(1)
            exact, area, claim = (
                np.array([vars(a)[p] for p in PARTS]) for a in (exact, area, claim)
            )
            found.append(area / np.where(exact > 0, exact, 1.0) - (exact > 0))
            claims.append(np.abs(area - exact) <= claim + 1e-9)
        rms = 100 * np.sqrt(np.mean(np.square(found), axis=0))
        row = {"hardness": hardness, "p0": load} | dict(zip(PARTS, rms, strict=True))
        rows.append(row | {"within": 100 * np.mean(claims)})
    return pd.DataFrame(rows)


def main():
    """Print the table of the scenes, and that of the aims, in %."""
    print(judged(SCENES).round(3).to_string(index=False))
    for points, wanted in AIMS.items():
        table = aims(points)
        print(f"{points} x {points} points, aims {wanted}, medians of rms errors below")
        print(table.round(2).to_string(index=False))
        print(table[list(PARTS)].median().round(2).to_string())


if __name__ == "__main__":
    main()
