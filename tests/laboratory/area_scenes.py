"""Corrected areas of scenes that once were wrong and sure of it, and of resolved roughness.

`SCENES` are those in which users found the corrected area far from the truth and the claimed error
smaller still; each says what was off then.  `aims` gives the mean and the rms error on rough
surfaces of three and four points per shortest wavelength.  References are finer grids, E* is 1 and
so is the period.

`python -m laboratory.area_scenes` prints both tables, in some three minutes of one core.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.areas import FINER, Maker, Member, Patch
from epcontact.studies.paper_scene import PARTS
from epcontact.surfaces import SelfAffine

#: Error of A, A_pl and A_el in % that is aimed at with four points per shortest wavelength.  With
#: three points, or a Hurst exponent of 0.3, it is twice as much.
AIMS = {"total": 0.3, "plastic": 0.5, "elastic": 1.0}


def _rough(patch: Patch, rng: np.random.Generator, hurst: float) -> FloatArray:
    """Self-affine roughness of rms slope 1."""
    wave = 2 * math.pi
    spectrum = SelfAffineSpectrum(hurst, wave, 2 * wave, patch.high * wave, 1.0)
    return SelfAffine(spectrum, (1.0, 1.0), patch.shape, int(rng.integers(1 << 31))).build().heights


def _posts(
    patch: Patch, rng: np.random.Generator, count: int, width: float, slope: float
) -> FloatArray:
    """Square posts, as wide as a cell of the coarse grid, on roughness of a slope."""
    heights = slope * _rough(patch, rng, 0.8)
    for _ in range(count):
        cell = (np.floor(rng.uniform(size=2) / width) + 0.5) * width
        x, y = patch.offsets(cell - 0.5 / np.array(patch.shape))
        post = np.maximum(np.abs(x), np.abs(y)) < width / 2
        heights = heights + post * (1.0 if count == 1 else rng.uniform(0.02, 0.1))
    return heights


def _disc(patch: Patch, rng: np.random.Generator, slope: float) -> FloatArray:
    """A plateau of radius 1/4, with flanks of a slope or, if it is infinite, a step of 1/2."""
    x, y = patch.offsets(np.array([0.503, 0.4988]))
    beyond = np.hypot(x, y) - 0.25
    return np.asarray(-slope * np.maximum(beyond, 0) if slope < np.inf else -0.5 * (beyond > 0))


def _strip(patch: Patch, rng: np.random.Generator) -> FloatArray:
    x, y = patch.offsets(np.array([0.5, 0.5]))
    return np.asarray(np.where(np.abs(y) < 0.201, 0.0, -1.0) + 0 * x)


def _worn(patch: Patch, rng: np.random.Generator) -> FloatArray:
    rough = _rough(patch, rng, 0.8)
    return np.asarray(np.minimum(rough, 0.4 * rough.std()))


@dataclass(frozen=True)
class Scene:
    """A surface under a load, what was off by how much, and how much finer its reference is."""

    name: str
    member: Member
    was: dict[str, str]
    finer: int = FINER


def _member(
    maker: Maker,
    points: int | tuple[int, int],
    load: float,
    hardness: float = math.inf,
    high: int = 16,
) -> Member:
    shape = points if isinstance(points, tuple) else (points, points)
    return Member(shape, (1.0, 1.0), load, hardness, high, maker, drawn=1)


_peak = partial(_posts, count=1, width=1 / 64, slope=0.0)
_outliers = partial(_posts, count=42, width=1 / 256, slope=0.02)
_hurst_3, _hurst_8 = partial(_rough, hurst=0.3), partial(_rough, hurst=0.8)
#: The errors that users found, and the claims beside them.
SCENES = (
    Scene("one peak, p0 1", _member(_peak, 64, 1.0, 5.0), {"total": "-30 % (.001)"}),
    Scene("one peak, p0 4.5", _member(_peak, 64, 4.5, 5.0), {"plastic": "1700 times (1.04)"}),
    Scene("42 outliers", _member(_outliers, 256, 0.05, 0.6, 8), {"total": "-24 % (.006)"}, 4),
    Scene(
        "disc punch, 128", _member(partial(_disc, slope=np.inf), 128, 0.05), {"total": "-7.6 %"}, 4
    ),
    Scene(
        "disc punch, 256", _member(partial(_disc, slope=np.inf), 256, 0.05), {"total": "-3.9 %"}, 4
    ),
    Scene("strip punch", _member(_strip, 96, 0.05), {"total": "-4.5 %"}, 4),
    Scene(
        "cone, slope .5",
        _member(partial(_disc, slope=0.5), 48, 0.03),
        {"total": "11 times claimed"},
    ),
    Scene("worn plateaus", _member(_worn, 64, 0.1, 0.6), {"plastic": "-42 % (4.4)"}),
    Scene(
        "Hurst .3, p0 .01",
        _member(_hurst_3, 64, 0.01, 0.6),
        {"total": "-1.85 % (1.87)", "plastic": "-2.3 %"},
    ),
    Scene(
        "Hurst .3, p0 .05",
        _member(_hurst_3, 64, 0.05, 0.6),
        {"total": "-.98 % (1.2)", "plastic": "-1.7 %"},
    ),
    Scene("dx = 2 dy", _member(_hurst_8, (64, 128), 0.05, 0.6), {"plastic": "-3.5 % (2.5)"}),
    Scene("Hurst .3, soft", _member(_hurst_3, 64, 0.05, 0.3), {"elastic": "-4.2 % (11-17)"}),
)


def judged(scenes: Iterable[Scene], seeds: Iterable[int] = range(1, 6)) -> pd.DataFrame:
    """Mean errors of the parts that were off, in % of the exact area, over seeds of the surface.

    Returns:
        A row for each scene and part: was, now (mean signed error), claimed (median), times (the
        largest error divided by its claim) and raw (mean signed error of the count).

    Raises:
        NotConverged: a solve does not converge.
    """
    rows = []
    for scene in scenes:
        found = []
        random = isinstance(scene.member.maker, partial) and scene.member.maker.func is _rough
        for seed in seeds if random or scene.member.maker is _worn else (1,):
            one = replace(scene.member, drawn=seed)
            found.append((*one.areas(1), one.areas(scene.finer)[1]))
        for part, was in scene.was.items():
            raw, now, claimed, exact = np.array(
                [[getattr(areas, part) for areas in one] for one in found]
            ).T
            rows.append(
                {
                    "scene": scene.name,
                    "part": part,
                    "was (claimed)": was,
                    "now": 100 * np.mean(now / exact - 1),
                    "claimed": 100 * np.median(claimed / exact),
                    "times": np.max(np.abs(now - exact) / claimed),
                    "raw": 100 * np.mean(raw / exact - 1),
                }
            )
    return pd.DataFrame(rows)


def aims(
    seeds: Iterable[int] = range(12), load: float = 0.1, hardness: float = 0.6, high: int = 16
) -> pd.DataFrame:
    """Mean and rms error in % on rough surfaces, and what is aimed at.

    Returns:
        A row for each Hurst exponent, number of points per shortest wavelength and part: mean,
        chance (standard error of the mean), rms, aim and claimed (median).

    Raises:
        NotConverged: a solve does not converge.
    """
    rows, seeds = [], list(seeds)
    for hurst in (0.8, 0.3):
        fine = {}
        for points in (4, 3):
            one = _member(partial(_rough, hurst=hurst), points * high, load, hardness, high)
            errors, claims = [], []
            for seed in seeds:
                if seed not in fine:  # 4 and 3 points share the reference
                    fine[seed] = replace(one, drawn=seed).areas(FINER)[1]
                _, now, claimed = replace(one, drawn=seed).areas(1)
                exact = np.array([getattr(fine[seed], part) for part in PARTS])
                errors.append([getattr(now, part) for part in PARTS] / exact - 1)
                claims.append([getattr(claimed, part) for part in PARTS] / exact)
            off = 100 * np.array(errors)
            twice = (2 if points == 3 else 1) * (2 if hurst < 0.5 else 1)
            figures = zip(
                PARTS, off.mean(0), off.std(0, ddof=1), np.sqrt((off**2).mean(0)), strict=True
            )
            for k, (part, mean, scatter, rms) in enumerate(figures):
                row = {"hurst": hurst, "points": points, "part": part, "mean": mean}
                chance = scatter / math.sqrt(len(seeds))
                row |= {"chance": chance, "rms": rms, "aim": twice * AIMS[part]}
                rows.append(row | {"claimed": 100 * float(np.median(np.array(claims)[:, k]))})
    return pd.DataFrame(rows)


def main() -> None:
    """Print the table of the scenes and that of the aims, in %."""
    print(judged(SCENES).round(3).to_string(index=False), flush=True)
    print(aims().round(3).to_string(index=False))


if __name__ == "__main__":
    main()
