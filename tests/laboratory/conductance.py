"""Make the table of what rough joints conduct, and fit the formula of `epcontact joint`
to it.

`python -m laboratory.conductance` measures `epcontact/studies/conductance.csv` anew, in
a quarter of an hour, and fits the formula; `python -m laboratory.conductance judge`
fits the kept table.  The constants come from every second Hurst exponent and hardness
of the blocks SEEN, the error from the rest of them.  The blocks UNSEEN, of other
exponents, breadths, hardnesses, loads and surfaces, serve neither, and say how many of
their places are within the error. `python -m laboratory.conductance corners` judges it
at the ends of the ranges, in a minute. `python -m laboratory.conductance spots` judges
laws of spots on the solver's own contacts, Holm's (every spot alone) and Greenwood's
(with their mutual resistance), Persson's theory of the mean separation, and contacts of
J2 flow, in five minutes.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

import fem_check
from epcontact import bem, effective_hardness
from epcontact.harness.gates import estimate
from epcontact.interface import contact_conductance
from epcontact.interface.percolation import number_patches
from epcontact.materials.moduli import effective_modulus
from epcontact.persson.separation import flattened_roughness, mean_separation
from epcontact.reference import conductance as laws
from epcontact.reference.bumps import MADELUNG
from epcontact.reference.layers import compliance
from epcontact.results import APART
from epcontact.scene import Body, Load
from epcontact.studies import conductance as study
from epcontact.studies.hardness import model_scene
from epcontact.studies.paper_scene import theory_of

FILE = Path(study.__file__).with_name("conductance.csv")
_FEW = {
    "hurst": (0.3, 0.6, 0.9),
    "hardness": (0.03, 0.1, 0.3, 1.0),
    "load": (0.01, 0.1),
}
_OTHER = {"hurst": (0.45, 0.7), "hardness": (0.045, 0.09, 0.2, 0.4, 0.7)}
#: The blocks of the table, and those that the fit does not see.
SEEN = [
    {"breadth": (8,), "hurst": (0.3, 0.6, 0.8, 0.9), "hardness": study.HARDNESSES}
    | {"load": study.LOADS, "seed": range(1, 17)},
    {"breadth": (2, 4), "seed": range(501, 517)} | _FEW,
    {"breadth": (16,), "seed": range(501, 505)} | _FEW,
    {"breadth": (32,), "seed": range(501, 505), "waves": (4,)} | _FEW,
]
UNSEEN = [
    {
        "breadth": (3, 6, 12),
        "load": (0.002, 0.006, 0.02, 0.06, 0.2),
        "seed": range(601, 609),
    }
    | _OTHER,
    {"breadth": (24,), "load": (0.006, 0.06), "seed": range(601, 605)} | _OTHER,
]


def table_of(blocks, say=print):
    """Return the table of mean conductances of blocks of places, with eight waves of
    the roll-off a period unless the block has its own number.

    `blocks` are options of `studies.conductance.means`, and `say` receives its
    progress.
    """
    found = [study.means(say, **({"waves": (8,)} | block)) for block in blocks]
    return pd.concat(found, ignore_index=True)


#: Contacts fuller than this teach nothing.
FULL = 0.4
#: Places at the ends of the accepted ranges, on surfaces of their own.
CORNERS = [
    {
        "breadth": (12,),
        "hurst": (0.35, 0.85),
        "hardness": (0.03, 0.1),
        "load": (0.003, 0.1, 0.24),
    },
    {
        "breadth": (2, 12),
        "hurst": (0.35, 0.85),
        "hardness": (0.7, 1.0),
        "load": (0.003, 0.11),
    },
    {
        "breadth": (2, 5),
        "hurst": (0.35, 0.85),
        "hardness": (0.03, 0.3),
        "load": (0.1, 0.21),
    },
]


def judged(table):
    """Return the rows of a table with many patches, whose contact area is at most
    FULL.
    """
    area = laws.contact_area(table["load"], table["hardness"])
    return table[(area <= FULL) & (table["patches"] >= study.FEWEST)]


def accepted(table):
    """Return the rows of a table of joints that `joint_conductance` accepts.

    Its columns are load (mean pressure over hardness), hardness (over E* times rms
    slope), breadth (of the spectrum: roll-off over shortest wavelength of the slope)
    and patches (number of contact patches), all without dimension.
    """
    area = laws.contact_area(table["load"], table["hardness"])
    kept = (area <= laws.FULL) & (table["patches"] >= study.FEWEST)
    for name, ends in (("load", laws.LOADS), ("breadth", laws.BREADTHS)):
        kept &= table[name].between(*ends)
    return table[kept]


def corners(seeds=range(811, 815)):
    """Return the accepted rows of new surfaces at CORNERS, with the formula over the
    measured value in the column `formula`.
    """
    table = accepted(
        table_of([block | {"seed": seeds} for block in CORNERS], lambda _: None)
    )
    return table.assign(
        formula=np.exp(misfit(table, (laws.FACTOR, laws.ELASTIC, laws.CLUSTER)))
    )


def parts(table):
    """Return three parts of a table: the rows that are fitted, those that give the
    error, and those of the blocks UNSEEN.
    """
    own = table["hurst"].isin(SEEN[0]["hurst"])
    seen = table[own]
    odd = (
        sum(seen[name].rank(method="dense") for name in ("hurst", "hardness")) % 2 == 1
    )
    return judged(seen[~odd]), judged(seen[odd]), judged(table[~own])


def misfit(table, constants):
    """Return ln(formula / measured y) of each row, (n,), with the constants FACTOR,
    ELASTIC and CLUSTER.

    y is the dimensionless conductance. The module's own constants are restored
    afterwards.
    """
    named = zip(("FACTOR", "ELASTIC", "CLUSTER"), constants, strict=True)
    kept = {name: getattr(laws, name) for name in ("FACTOR", "ELASTIC", "CLUSTER")}
    try:
        for name, value in named:
            setattr(laws, name, value)
        y = laws.fitted(
            *(table[name].to_numpy() for name in ("load", "hardness", "breadth"))
        )
    finally:
        for name, value in kept.items():
            setattr(laws, name, value)
    return np.log(y / table["y"].to_numpy())


def fit(table):
    """Return the constants FACTOR, ELASTIC and CLUSTER by least squares over the rows
    of a table.

    The weight of a row includes 4 %, which is about the error of the formula beside the
    scatter.
    """
    weight = 1 / np.hypot(0.04, table["half_width"].to_numpy() / 2)
    start = np.array([laws.FACTOR, laws.ELASTIC, laws.CLUSTER])
    return least_squares(lambda c: misfit(table, c) * weight, start, x_scale=start).x


def report(table):
    """Fit a table and print the constants, the error, its coverage, and the errors of
    the laws of the literature.
    """
    fitted, other, unseen = parts(table)
    constants = fit(fitted)
    error = 2 * float(np.sqrt(np.mean(misfit(other, constants) ** 2)))
    print("FACTOR, ELASTIC, CLUSTER, ERROR", np.round(constants, 3), f"{error:.3f}")
    print("in use", laws.FACTOR, laws.ELASTIC, laws.CLUSTER, laws.ERROR)
    named = {"fitted": fitted, "error": other, "unseen": unseen}
    named |= {f"accepted of {name}": accepted(rows) for name, rows in named.items()}
    for name, rows in named.items():
        off = np.abs(misfit(rows, constants))
        inside = (off < np.log1p(error)).mean()
        print(
            f"{name}: {len(off)} places, {inside:.3f} inside, at most {off.max():.3f}"
        )
    print(ranges(table))


def ranges(table):
    """Return a text with the least and greatest ratio of each law to the boundary
    elements, and the fractions of places within 10 and 20 %, by hardness and breadth.
    """
    found = study.ratios(table).dropna(subset=study.RATIO)
    off = np.abs(np.log(found[study.RATIO]))
    found = found.assign(within_10=off < np.log(1.1), within_20=off < np.log(1.2))
    found["hardnesses"] = pd.cut(
        found["hardness"], [0, 0.05, 0.1, 0.2, 0.4, 0.5, 0.7, 1]
    )
    every = found.assign(breadths="every")
    found["breadths"] = pd.cut(found["breadth"], [0, 4, 8, 16, 32]).astype(str)
    groups = pd.concat([every, found]).groupby(
        ["law", "breadths", "hardnesses"], observed=True
    )
    shares = groups[["within_10", "within_20"]].mean()
    return (
        groups[study.RATIO]
        .agg(["min", "max", "size"])
        .join(shares)
        .round(2)
        .to_string()
    )


# --- spots and J2 contacts
# -----------------------------------------------------------------------


def by_spots(mask, C):
    """Return 1/k by Holm's and by Greenwood's sum over the patches of a mask.

    E* and the period are 1.  The pressure of a patch is that of a disc of its area, in
    proportion to its radius.  C: compliance of each mode, 0 for the mean.
    """
    patch_of_point, _ = number_patches(mask)
    radius = np.sqrt(np.bincount(patch_of_point) / mask.size / math.pi)
    force = radius / radius.sum()
    loads = np.zeros(mask.shape)
    np.add.at(loads, _centres(mask, patch_of_point), force * mask.size)
    unit_load = np.zeros(mask.shape)
    unit_load[0, 0] = mask.size

    def displacement(pressure):
        """Return the displacement of a pressure field on the grid of the mask, by the
        compliance C of each Fourier mode.
        """
        return np.fft.irfft2(C * np.fft.rfft2(pressure), mask.shape)

    holm = 1 / (2 * radius.sum())
    own_displacement = displacement(unit_load)[0, 0]
    square_force = (force**2).sum()
    mutual = (loads * displacement(loads)).mean() - square_force * own_displacement
    return holm, holm + mutual - MADELUNG / math.pi * square_force


def _centres(mask, patch_of_point):
    """Return the grid indices (rows, columns) of the mean position of each patch.

    The mean of positions on a period is the direction of the mean of their unit
    vectors.
    """
    centres = []
    for index, points in zip(np.nonzero(mask), mask.shape, strict=True):
        angle = 2 * np.pi * index / points
        east = np.bincount(patch_of_point, np.cos(angle))
        north = np.bincount(patch_of_point, np.sin(angle))
        position = np.arctan2(north, east) / (2 * np.pi) * points
        centres.append(np.round(position).astype(int) % points)
    return tuple(centres)


def spots(seeds=range(1, 5)):
    """Return Holm's and Greenwood's conductance over that of the solver, on the
    solver's contacts, as means and standard deviations by hardness and load.
    """
    found = []
    for hardness in (0.06, 0.25, 1.0):
        for load in (0.003, 0.03, 0.1, 0.3):
            for seed in seeds:
                scene = study.joint_scene(8, 0.8, hardness, load, seed, 8)
                result = bem.solve(scene, threads=1)
                C = compliance(scene)
                C.flat[0] = 0.0
                u = 2 / contact_conductance(scene, result, 1.0).corrected
                ratios = [
                    u / each for each in by_spots(result.fields["state"] != APART, C)
                ]
                found.append((hardness, load, *ratios))
    table = pd.DataFrame(found, columns=["hardness", "load", "Holm", "Greenwood"])
    return table.groupby(["hardness", "load"]).agg(["mean", "std"]).round(3)


def by_theory(table):
    """Return the conductance by Persson's theory over that of the table, by Hurst
    exponent, hardness and load.

    In the theory the surface that the load has flattened springs back elastically, so
    that the stiffness is -dp/du of the mean separation u.
    """
    found = []
    for place in table.to_dict("records"):
        at = {name: place[name] for name in study.PLACE}
        scene = study.joint_scene(**at, seed=1, waves=8)
        up = theory_of(scene)
        p = scene.load.final
        down = replace(up, roughness=flattened_roughness(up, p), hardness=math.inf)
        above, below = (mean_separation(down, p * math.exp(s)) for s in (-0.01, 0.01))
        k = 0.02 * p / (above - below)
        found.append(k * scene.surface.rms_height * laws.PROFILE / place["y"])
    return (
        table.assign(theory=found)
        .pivot_table("theory", ["hurst", "hardness"], "load")
        .round(2)
    )


def j2(seeds=range(1, 4), nodes=48, waves=6):
    """Return, by severity and load, the conductance of a cap of the mapped hardness and
    of the laws over that of J2 bodies.

    `nodes` is the number of nodes a side, and `waves` that of the shortest waves a
    period; `cap_half_width` is the 95 % half-width of the cap's.
    """
    found = []
    for severity in (5.0, 15.0, 50.0):
        for load in (0.1, 0.25, 0.5):
            for seed in seeds:
                scene = model_scene(severity, 0.3, seed, nodes, waves)
                body = scene.material
                scene = replace(scene, load=Load(load * body.yield_stress))
                flat = {
                    "yield_stress": body.yield_stress,
                    "mean_pressure": scene.load.final,
                }
                flat |= {"young_modulus": body.young_modulus, "poisson_ratio": 0.3}
                cap = effective_hardness(rms_slope=0.05, **flat)
                capped = replace(
                    scene, body=Body(), material=replace(body, hardness=cap.value)
                )
                one = fem_check.solve(scene, law="j2", steps=8, certified=False)
                both = one, bem.solve(capped, threads=1)
                h, by_cap = (
                    contact_conductance(capped, r, 2.0).corrected for r in both
                )
                at = load / cap.ratio, cap.value / (effective_modulus(body) * 0.05)
                unit = 0.05 / math.sqrt(math.pi) / scene.surface.rms_height
                said = [unit * law(*at) for law in laws.LAWS.values()]
                said.append(unit * laws.fitted(*at, float(waves)))
                found.append((severity, load, by_cap / h, *(np.array(said) / h)))
    names = ["severity", "load", "cap", *laws.LAWS, study.FORMULA]
    table = pd.DataFrame(found, columns=names)
    half = table.groupby(names[:2])["cap"].agg(
        lambda v: estimate(v.to_numpy()).half_width
    )
    return table.groupby(names[:2]).mean().assign(cap_half_width=half).round(3)


if __name__ == "__main__":
    if sys.argv[1:] == ["spots"]:
        theory = by_theory(
            study.table_of_package().query("breadth == 8 and hurst in (0.3, 0.8)")
        )
        print(*(each.to_string() for each in (spots(), theory, j2())), sep="\n")
    elif sys.argv[1:] == ["corners"]:
        print(corners().round(3).to_string())
    elif sys.argv[1:] == ["judge"]:
        report(study.table_of_package())
    else:
        table = table_of(SEEN + UNSEEN)
        table.round(5).to_csv(FILE, index=False)
        report(table)
