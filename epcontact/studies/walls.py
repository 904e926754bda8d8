"""The walls of the theory: how the pressures move when the next waves of a surface are added.

The theory lets the pressure of a point diffuse at one rate, without drift, until it is absorbed at
zero or at the hardness.  Here the same surface is solved without and with its last ring of waves,
weakened to a share w of its power and with either sign, so that what is odd in it cancels.  With
dG, what the ring adds to G in full contact, and d, the change of a point's pressure, points of
pressure sigma have the diffusion <d^2>/(2 dG) (1 in full contact) and the drift <d>/dG.

Any change of P that keeps the load is one without drift, between absorbing walls, by

    dP/dG = d^2(S P)/dsigma^2,    S P = dM/dG,    M(sigma) = <max(p - sigma, 0)>,

as M'' = P.  This S is the only one that a theory needs, and it has a limit for weak rings, which
diffusion and drift near the walls do not have: the front of a contact moves as the root of w.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

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
#: p0 and hardness over E* xi, xi being the slope without the ring.
PLACES = [(p, h) for h in (0.3, 0.6, 1.2) for p in (0.02, 0.1, 0.25)]
PLACES += [(p, math.inf) for p in (0.02, 0.1, 0.4)]
#: Intervals of the pressure, to the hardness or three times E* xi; a mean needs so many points.
BINS, FEWEST = 20, 30
_X = ("relative_pressure", r"contact pressure $\sigma / (E^* \xi)$ (–)")
_ROOT = ("root_of_step", r"root of the step, $\sqrt{\Delta G / G}$ (–)")


def steps(
    seed: int, bandwidth: int, place: tuple[float, float], points: int, shares: Sequence[float]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Add the ring to a surface: the flows through each wall, and what each pressure does."""
    whole = paper.rough_scene(points, seed, bandwidth).surface
    base = filtered(whole, (1 - 1 / PARTS) * bandwidth * paper.LOWEST)
    before, after = (persson.roughness_of(s, "surface").rms_slope ** 2 for s in (base, whole))
    (p0, hardness), ring, unit = place, whole.heights - base.heights, paper.MODULUS * before**0.5
    body, cap = Material(paper.MODULUS, 0.0, hardness * unit), hardness * (1 - 1e-12)

    def pressures(strength: float) -> FloatArray:
        surface = replace(base, heights=base.heights + strength * ring)
        solved = bem.solve(Scene(surface, body, Load(p0 * unit)))
        return np.asarray(solved.fields["pressure"] / unit)

    def above(p: FloatArray) -> FloatArray:
        return np.array([np.maximum(p - sigma, 0).mean() for sigma in middle])

    p, angle = pressures(0.0), np.pi * np.arange(BINS + 1) / BINS
    edges = hardness / 2 * (1 - np.cos(angle)) if hardness < math.inf else 3 - 3 * np.cos(angle / 2)
    middle, elastic = (edges[1:] + edges[:-1]) / 2, (p > 0) & (p < cap)
    bins = np.minimum(np.searchsorted(edges, p[elastic], side="right") - 1, BINS - 1)
    count, flows, found = np.bincount(bins, minlength=BINS), [], []
    density, good = np.maximum(count, 1) / p.size / np.diff(edges), count >= FEWEST
    for share in shares:
        both = [pressures(sign * math.sqrt(share)) for sign in (1, -1)]
        dG = share * (after / before - 1) / 8
        name = {"seed": seed, "bandwidth": bandwidth, "p0": p0, "hardness": hardness, "w": share}
        states = {"zero": [x <= 0 for x in (p, *both)], "hardness": [x >= cap for x in (p, *both)]}
        for wall, (was, *now) in states.items():
            go, back = np.mean([[(x & ~was).mean(), (was & ~x).mean()] for x in now], axis=0)
            flow = {"wall": wall, _ROOT[0]: round(math.sqrt(8 * dG), 6), "net": (go - back) / dG}
            flows += [name | flow | {"returned": back / go}] if go else []
        change = np.array([q[elastic] - p[elastic] for q in both])
        sums = [np.bincount(bins, (change**k).mean(axis=0), BINS) for k in (1, 2)]
        drift, square = (total / np.maximum(count, 1) / dG for total in sums)
        reduction = (np.mean([above(q) for q in both], axis=0) - above(p)) / dG / density
        columns = {_X[0]: middle, "diffusion": square / 2, "drift": drift, "reduction": reduction}
        found.append(pd.DataFrame(columns)[good].assign(**name))
    return pd.DataFrame(flows), pd.concat(found)


def limits(flows: pd.DataFrame) -> pd.DataFrame:
    """The returned share at a vanishing step, by a line in its root for each surface."""
    found, keys = [], ["hardness", "p0", "bandwidth", "wall"]
    for place, group in flows.groupby(keys, sort=False):
        table = group.pivot(index="seed", columns="w", values="returned").dropna()
        if len(table) > 1:
            ends = [np.polyfit(np.sqrt(table.columns), row, 1)[1] for row in table.to_numpy()]
            limit = estimate(ends)
            found.append((*place, limit.mean, limit.half_width))
    return pd.DataFrame(found, columns=[*keys, "limit", "half_width"])


@study("walls", bandwidths=(16, 32, 64), seeds=range(1, 17))
def walls(
    say: Say, bandwidths: Ints = (16,), seeds: Ints = range(1, 5), points: int = 8,
    places: Sequence[tuple[float, float]] = PLACES, shares: Sequence[float] = SHARES,
) -> Charts:  # fmt: skip
    """Flow through both walls, diffusion and drift of the pressures as waves are added.

    The same surfaces without and with their last sixteenth of the wave numbers, weakened to shares
    of its power and with both signs; H = 0.8, roll-off at four times q_0.  The places are pairs of
    p0 and hardness over E* xi, the hardness infinite for elastic bodies.  Next to a wall diffusion
    and drift grow as the step shrinks, and as many points return as go, because fronts move to and
    fro as the root of the step: neither is a property of the wall.  The net flow has a limit, and
    so has the S which alone, without drift or return, gives the distribution; within .1 E* xi of
    a wall the grid's density is too large, and this S too small.  Of elastic bodies Dapp, Prodanov
    and Mueser (J. Phys.: Condens. Matter 26, 355002, 2014) report in their abstract a diffusion
    that depends on small pressures, a substantial drift there and a flow back into contact, as
    here; their figures were not at hand.
    """
    parts = []
    for bandwidth, place, seed in product(bandwidths, places, seeds):
        say(f"bandwidth {bandwidth}, p0 and hardness {place} E* xi, seed {seed}")
        parts.append(steps(seed, bandwidth, place, points, shares))
    flows, table = (pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True))
    for one in (flows, table):
        named = zip(one["hardness"], one["p0"], strict=True)
        one["place"] = [f"hardness {h:g}, p0 {p:g}" for h, p in named]
        one["ring"] = one["w"].map("w = {:.3g}".format)
    ends, widest = limits(flows), max(bandwidths)
    sure = ends[ends["half_width"] < 0.1]
    reach = f"for vanishing steps {sure['limit'].min():.2f} to {sure['limit'].max():.2f} at the"
    known = f"{reach} {len(sure)} walls, places and bandwidths where that is known to 0.1"
    told_limits = known if len(sure) else "too few surfaces for its limit"
    plot = Plot(_ROOT, ("returned", "points that return over those that go (–)"), level=1.0)
    plot = replace(plot, series=("place",), colour="place", limits={"ylim": (0, 1.2)})
    for wall, rows in flows[flows["bandwidth"] == widest].groupby("wall", sort=False):
        yield plot, rows, f"Return through the wall at {wall}, {told_limits}"
    wide, (p0, hardness) = table[table["bandwidth"] == widest], places[len(places) // 3]
    near = wide[(wide["p0"] == p0) & (wide["hardness"] == hardness)]
    where = f"at {near['place'].iloc[0]}"
    y = ("diffusion", r"diffusion $\langle d^2 \rangle / 2 \Delta G$ (–)")
    yield Plot(_X, y, ("ring",), level=1.0), near, f"Diffusion by the pressure {where}"
    y = ("drift", r"drift $\langle d \rangle E^* \xi / \Delta G$ (–)")
    yield Plot(_X, y, ("ring",), level=0.0), near, f"Drift by the pressure {where}"
    y = ("reduction", "S without drift or return (–)")
    plot = Plot(_X, y, ("place",), level=paper.GAMMA, limits={"ylim": (0, 1.2), "xlim": (0, 1.5)})
    wide = wide[wide["w"] == max(shares)].sort_values(["hardness", "p0", _X[0]])
    yield plot, wide, "The reduction S that gives the distribution, beside the paper's gamma"
