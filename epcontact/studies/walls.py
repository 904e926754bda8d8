"""The walls of the theory: how the pressures move when the next waves of a surface are
added.

The theory lets the pressure of a point diffuse at one rate, without drift, until it is
absorbed at zero or at the hardness.  Here the same surface is solved without and with
its last ring of waves, weakened to a share w of its power and with either sign, so that
what is odd in it cancels.  With dG, what the ring adds to G in full contact, and d, the
change of a point's pressure, points of pressure sigma have the diffusion <d^2>/(2 dG)
(1 in full contact) and the drift <d>/dG.

Any change of P that keeps the load is one without drift, between absorbing walls, by

    dP/dG = d^2(S P)/dsigma^2,    S P = dM/dG,    M(sigma) = <max(p - sigma, 0)>,

as M'' = P.  This S is the only one that a theory needs, and it has a limit for weak
rings, which diffusion and drift near the walls do not have: the front of a contact
moves as the root of w.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.harness.gates import estimate
from epcontact.output.charts.plot import Plot
from epcontact.results import FloatArray
from epcontact.scene import Load, Material, Scene
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import Charts, Ints, Say, study
from epcontact.surfaces import filtered

#: The ring is the last of so many parts of the wave numbers; its shares of the power.
PARTS, SHARES = 16, (1.0, 1 / 4, 1 / 16)
#: p0 and hardness over E* xi, xi being the slope without the ring; charts show the
#: middle load.
PLACES = [(p, h) for h in (0.3, 0.6, 1.2) for p in (0.02, 0.1, 0.25)]
PLACES += [(p, math.inf) for p in (0.02, 0.1, 0.4)]
_SHOWN, _MIDST = 0.1, 1.2
#: Intervals of the pressure, to the hardness or three times E* xi; a mean needs so many
#: points.
BINS, FEWEST = 20, 30
_X = ("relative_pressure", r"contact pressure $\sigma / (E^* \xi)$ (–)")
_ROOT = ("root_of_step", r"root of the step, $\sqrt{\Delta G / G}$ (–)")


def steps(
    seed: int,
    bandwidth: int,
    place: tuple[float, float],
    points: int,
    shares: Sequence[float],
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Add the ring to a surface: the flows through each wall, and what each pressure
    does.
    """
    whole = paper.rough_scene(points, seed, bandwidth).surface
    base = filtered(whole, (1 - 1 / PARTS) * bandwidth * paper.LOWEST)
    before, after = (
        persson.roughness_of(s, "surface").rms_slope ** 2 for s in (base, whole)
    )
    (p0, hardness), ring, unit = (
        place,
        whole.heights - base.heights,
        paper.MODULUS * before**0.5,
    )
    body, cap = Material(paper.MODULUS, 0.0, hardness * unit), hardness * (1 - 1e-12)

    def pressures(strength: float) -> FloatArray:
        surface = replace(base, heights=base.heights + strength * ring)
        solved = bem.solve(Scene(surface, body, Load(p0 * unit)))
        return np.asarray(solved.fields["pressure"] / unit)

    def above(p: FloatArray) -> FloatArray:
        return np.array([np.maximum(p - sigma, 0).mean() for sigma in middle])

    p, angle = pressures(0.0), np.pi * np.arange(BINS + 1) / BINS
    edges = (
        hardness / 2 * (1 - np.cos(angle))
        if hardness < math.inf
        else 3 - 3 * np.cos(angle / 2)
    )
    middle, elastic = (edges[1:] + edges[:-1]) / 2, (p > 0) & (p < cap)
    bins = np.minimum(np.searchsorted(edges, p[elastic], side="right") - 1, BINS - 1)
    count, flows, found = np.bincount(bins, minlength=BINS), [], []
    density, good = np.maximum(count, 1) / p.size / np.diff(edges), count >= FEWEST
    for share in shares:
        both = [pressures(sign * math.sqrt(share)) for sign in (1, -1)]
        dG = (step := share * (after / before - 1)) / 8
        name = {
            "seed": seed,
            "bandwidth": bandwidth,
            "p0": p0,
            "hardness": hardness,
            "w": share,
        }
        more = {
            "step": f"ΔG/G = {100 * step:.2g} %",
            _ROOT[0]: round(math.sqrt(step), 6),
        }
        states = {
            "zero": [x <= 0 for x in (p, *both)],
            "hardness": [x >= cap for x in (p, *both)],
        }
        for wall, (was, *now) in states.items():
            go, back = np.mean(
                [[(x & ~was).mean(), (was & ~x).mean()] for x in now], axis=0
            )
            flows += (
                [name | more | {"wall": f"at {wall}", "returned": back / go}]
                if go
                else []
            )
        change = np.array([q[elastic] - p[elastic] for q in both])
        sums = [np.bincount(bins, (change**k).mean(axis=0), BINS) for k in (1, 2)]
        drift, square = (total / np.maximum(count, 1) / dG for total in sums)
        reduction = (
            (np.mean([above(q) for q in both], axis=0) - above(p)) / dG / density
        )
        columns = {
            _X[0]: middle,
            "diffusion": square / 2,
            "drift": drift,
            "reduction": reduction,
        }
        found.append(pd.DataFrame(columns)[good].assign(**name, **more))
    return pd.DataFrame(flows), pd.concat(found)


def limits(flows: pd.DataFrame) -> pd.DataFrame:
    """The returned share at a vanishing step, by a line in its root for each
    surface.
    """
    found, keys = [], ["hardness", "p0", "bandwidth", "wall"]
    for place, group in flows.groupby(keys, sort=False):
        table = group.pivot(index="seed", columns="w", values="returned").dropna()
        if len(table) > 1:
            ends = [
                np.polyfit(np.sqrt(table.columns), row, 1)[1]
                for row in table.to_numpy()
            ]
            limit = estimate(ends)
            found.append((*place, limit.mean, limit.half_width))
    return pd.DataFrame(found, columns=[*keys, "limit", "half_width"])


@study("walls", bandwidths=(16, 32, 64), seeds=range(1, 17))
def walls(
    say: Say, bandwidths: Ints = (16,), seeds: Ints = range(1, 9), points: int = 8
) -> Charts:
    """How pressures move as waves are added.

    They add ΔG to G, half the pressures' variance in full contact.  Load 0.1 E* xi,
    hardness in E* xi.
    """
    parts = []
    for bandwidth, place, seed in product(bandwidths, PLACES, seeds):
        say(f"bandwidth {bandwidth}, p0 and hardness {place} E* xi, seed {seed}")
        parts.append(steps(seed, bandwidth, place, points, SHARES))
    flows, table = (
        pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True)
    )
    ends, bodies = limits(flows), {h: f"hardness {h:g}" for h in (0.3, 0.6, 1.2)}
    sure = ends[ends["half_width"] < 0.1]["limit"]

    def shown(table: pd.DataFrame) -> pd.DataFrame:
        table = table[(table["bandwidth"] == max(bandwidths)) & (table["p0"] == _SHOWN)]
        return table.assign(body=table["hardness"].map(bodies).fillna("no hardness"))

    flows, table = (
        shown(flows),
        shown(table).sort_values(["hardness", _X[0]], kind="stable"),
    )
    y = ("returned", "points that return over those that go (–)")
    look: Any = {"colour": "body", "mark": "wall", "limits": {"ylim": (0.5, 1.1)}}
    plot = Plot(_ROOT, y, ("body", "wall"), level=1.0, **look)
    reach = (
        f"{sure.min():.2f} to {sure.max():.2f} at the {len(sure)} of {len(ends)} walls"
    )
    said = "Weaker steps: more points return through a wall"
    yield (
        plot,
        flows,
        said + (f" (limits {reach} that tell it to 0.1)" if len(sure) else ""),
    )
    near = table[table["hardness"] == _MIDST]
    told = f"d: a point's change of pressure; hardness {_MIDST:g}"
    for name, label, level in (
        ("diffusion", r"diffusion $\langle d^2 \rangle / 2 \Delta G$ (–)", 1.0),
        ("drift", r"drift $\langle d \rangle E^* \xi / \Delta G$ (–)", 0.0),
    ):
        said = f"Near the walls {name} grows as the step shrinks ({told})"
        yield Plot(_X, (name, label), ("step",), level=level), near, said
    y = ("reduction", "reduction S without drift (–)")
    plot = Plot(
        _X, y, ("body",), level=paper.GAMMA, limits={"ylim": (0, 1.2), "xlim": (0, 1.5)}
    )
    said = (
        "The S that gives the distribution rises away from walls; dotted: gamma = 0.536"
    )
    yield plot, table[table["w"] == max(SHARES)], said
