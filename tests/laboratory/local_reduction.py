"""The laboratory of the rule "local": it fits gamma, b and c of
`epcontact.persson.local`.

Boundary elements give the corrected areas of 30 places of the plane (p0 and hardness
over E* xi), on spectra with and without roll-off.  Every second Hurst exponent,
bandwidth and seed is fitted, the others only judge.  The misfit of an area is that of
its logarithm over the aim (2 % for A, 5 % for A_el and A_pl) and its own scatter and
claim together, with outliers damped (soft L1).  Areas below a thousandth are a few grid
points, and left out.

`python -m laboratory.local_reduction [KEPT.jsonl]` prints the fit and the errors of the
rule and of the paper's, on both halves and on the map of `persson.validity`, whose
plane is wider.  It solves 1680 scenes in some ten minutes, but none that the file
holds.
"""

import json
import math
import sys
from importlib.resources import files
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from epcontact import bem, persson
from epcontact.persson.local import CONSTANTS, integrate, relative_wavenumbers
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum
from epcontact.studies.paper_scene import GAMMA, LOWEST, MODULUS
from epcontact.surfaces import SelfAffine

HALVES = {
    "fitted": {"hurst": (0.3, 0.8), "bandwidth": (32, 128), "seed": (1, 2, 3, 4)},
    "judged": {"hurst": (0.5, 0.95), "bandwidth": (64, 256), "seed": (5, 6, 7, 8)},
}
ROLL_OFFS = (1, 4)
LOADS = (0.005, 0.02, 0.05, 0.1, 0.2, 0.4)
HARDNESSES = (0.1, 0.16, 0.3, 0.6, 1.2, math.inf)
PLACES = [(p, h) for h, p in product(HARDNESSES, LOADS) if p < 0.85 * h]
AIMS = {"total": 0.02, "elastic": 0.05, "plastic": 0.05}
LEAST = 1e-3
SPECTRUM = ["half", "hurst", "bandwidth", "roll_off"]


def spectrum_of(hurst, bandwidth, roll_off):
    """Return the spectrum of rms slope 1; bandwidth and roll-off are multiples of the
    lowest wavenumber.
    """
    return SelfAffineSpectrum(hurst, LOWEST, roll_off * LOWEST, bandwidth * LOWEST, 1.0)


def solved(hurst, bandwidth, roll_off, seed):
    """Yield a row for each load and hardness of PLACES: the corrected areas by boundary
    elements and their estimated errors.

    The arguments are those of `spectrum_of` and the seed of the surface; areas are
    fractions of the nominal area.
    """
    spectrum = spectrum_of(hurst, bandwidth, roll_off)
    side = 4 * bandwidth
    surface = SelfAffine(
        spectrum, (2 * math.pi / LOWEST,) * 2, (side, side), seed
    ).build()
    for p0, hardness in PLACES:
        body = Material(MODULUS, 0.0, hardness * MODULUS)
        load = Load(p0 * MODULUS)
        areas = bem.solve(Scene(surface, body, load), area_tolerance=1e-4).final.areas
        found = {part: getattr(areas["corrected"], part) for part in AIMS}
        claims = {f"{part}_error": getattr(areas["error"], part) for part in AIMS}
        yield {"p0": p0, "hardness": hardness} | found | claims


def measured(kept):
    """Return mean areas over the seeds of every place and spectrum, with the error of
    each mean.

    `kept` is a file of solved rows, one JSON object a line, to which new rows are
    appended, or None.
    """
    lines = kept.read_text().splitlines() if kept and kept.exists() else []
    rows = [json.loads(line) for line in lines]
    keys = (*SPECTRUM, "seed")
    there = {tuple(row[key] for key in keys) for row in rows}
    for half, axes in HALVES.items():
        for hurst, bandwidth, seed, roll_off in product(*axes.values(), ROLL_OFFS):
            place = (hurst, bandwidth, roll_off, seed)
            # Two wide surfaces average as much as many narrow ones.
            if (half, *place) in there or (bandwidth > 200 and seed > 6):
                continue
            name = dict(zip(keys, (half, *place), strict=True))
            new = [name | row for row in solved(*place)]
            rows += new
            if kept:
                with kept.open("a") as file:
                    file.writelines(json.dumps(row) + "\n" for row in new)
    groups = pd.DataFrame(rows).groupby([*SPECTRUM, "p0", "hardness"])
    mean = groups.mean(numeric_only=True)
    for part in AIMS:
        scatter = groups[part].std() / np.sqrt(groups.size())
        mean[f"{part}_error"] = np.hypot(scatter, mean[f"{part}_error"])
    return mean.reset_index()


def by_local(table, constants, resolution):
    """Return the areas by the theory with the rule "local", (rows, 3), in the order of
    AIMS.

    `constants` are gamma, b and c of the rule; loads and hardnesses of the table are
    over E* times rms slope.
    """
    paths = {}
    for spectrum in set(table[SPECTRUM[1:]].itertuples(index=False, name=None)):
        variance, breadth = relative_wavenumbers(
            persson.analytic_roughness(spectrum_of(*spectrum))
        )
        paths[spectrum] = variance / 8, breadth
    found = []
    for row in table.itertuples():
        path = paths[row.hurst, row.bandwidth, row.roll_off]
        end = integrate(*path, row.p0, row.hardness, tuple(constants), resolution).areas
        found.append((end.total, end.elastic, end.plastic))
    return np.array(found)


def usable(table):
    """Return a mask (rows, 3) of the areas above LEAST, without the parts of elastic
    bodies, which equal the total area or 0.
    """
    large = table[[*AIMS]].to_numpy() > LEAST
    large[np.isinf(table["hardness"]), 1:] = False
    return large


def fit(table, start=CONSTANTS):
    """Return the constants gamma, b and c of the rule "local" that fit the areas of a
    table.
    """
    area = table[[*AIMS]].to_numpy()
    aims = np.array([*AIMS.values()])
    error = table[[f"{part}_error" for part in AIMS]].to_numpy()
    scale = np.hypot(
        aims, np.divide(error, area, out=np.ones_like(area), where=area > 0)
    )
    used = usable(table)

    def misfit(constants):
        """Return ln(area of the rule / measured area) over its allowed error, (n,), for
        the constants gamma, b and c.
        """
        found = by_local(table, constants, (25, 4))
        return (np.log(found[used] / area[used])) / scale[used]

    bounds = ([0.01] * 3, [1.0] * 3)
    return least_squares(
        misfit, start, "2-point", bounds, loss="soft_l1", diff_step=0.01
    ).x


def over_the_map():
    """Return the package's map of the theory's error in the columns of `measured`, and
    the areas (rows, 3) by the rule of the paper.
    """
    table = pd.read_csv(files("epcontact.persson") / "theory_map.csv", comment="#")
    table["p0"] = table["load"] * table["hardness"].replace(math.inf, 1.0)
    table = table.rename(columns={"wavelength_ratio": "bandwidth"})
    off = table[[f"{part}_theory" for part in AIMS]].to_numpy()
    return table, table[[*AIMS]].to_numpy() * (1 + off)


def report(name, found, table):
    """Print rms, median, 95 % and largest error of each area in %, and the percentage
    of errors below its aim.

    `found` are the areas (rows, 3) to compare with those of the table.
    """
    area = table[[*AIMS]].to_numpy()
    used = usable(table)
    for i, (part, aim) in enumerate(AIMS.items()):
        off = 100 * (found[used[:, i], i] / area[used[:, i], i] - 1)
        within = 100 * np.mean(abs(off) < 100 * aim)
        middle, wide = np.quantile(abs(off), [0.5, 0.95])
        figures = math.sqrt(np.mean(off**2)), middle, wide, abs(off).max(), within
        said = "rms {:.1f} median {:.1f} 95 % {:.1f} most {:.0f} within {:.0f}".format(
            *figures
        )
        print(f"{name:28}{part:9}{said}")


def main():
    """Fit the constants to the half "fitted", and print the errors of both halves and
    of the map.
    """
    table = measured(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    constants = fit(table[table["half"] == "fitted"])
    print("gamma, b, c", constants.round(4), "in use", CONSTANTS)
    for half, rolled in product(HALVES, ROLL_OFFS):
        rows = table[(table["half"] == half) & (table["roll_off"] == rolled)]
        report(
            f"{half}, roll-off {rolled}, local",
            by_local(rows, CONSTANTS, (50, 8)),
            rows,
        )
        paper = persson.areas(GAMMA / 8, rows["p0"], rows["hardness"])
        paper = np.column_stack([getattr(paper, part) for part in AIMS])
        report(f"{half}, roll-off {rolled}, paper's", paper, rows)
    places, paper = over_the_map()
    report("map, local", by_local(places, CONSTANTS, (50, 8)), places)
    report("map, paper's", paper, places)


if __name__ == "__main__":
    main()
