"""What the breadth of a spectrum changes in the effective hardness, by J2 bodies of
other spectra.

`python -m laboratory.breadth`, run in tests, fits the term of
`materials/hardness_map.py` to one half of the ensembles that `breadth.csv` keeps and
judges the others in a table; those with seeds from 401 were solved after the constants
had been chosen.  `--solve` first solves all of them anew, and `--solve QUERY` those of
a pandas query alone, such as "severity == 100 and waves == 16". An ensemble is compared
with one of the map's kind on as many nodes to the shortest wave.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from epcontact.materials import hardness_map as kept
from laboratory.hardness_map import inverse_hardness
from laboratory.light_loads import areas

FILE = Path(__file__).with_suffix(".csv")
#: What tells an ensemble, and what it has in common with that of the map's kind.
METAL = ["nodes", "poisson_ratio", "severity", "load"]
SPECTRUM = ["waves", "roll_off", "hurst"]
LOADS = (0.1, 0.25, 0.5, 1.0)
MAP = (4, 1, 0.8)
#: The spectra of the fit, which is at 6 nodes to the shortest wave and Poisson's ratio
#: .3.
FITTED = [(2, 1, 0.8), (8, 1, 0.8), (32, 1, 0.8), (8, 4, 0.8), (32, 4, 0.8)]


def solved(rows):
    """Yield a table for each ensemble of `rows` with its hardness solved again.

    The column `ratio` is the effective hardness over the yield stress, and `error` its
    relative 95 % error.
    """
    for key, old in rows.groupby([*METAL[:3], *SPECTRUM, "first_seed"], sort=False):
        nodes, nu, severity, waves, roll_off, hurst, seed = key
        shape = {"roll_off": roll_off, "hurst": hurst, "nu": nu, "loads": old["load"]}
        seeds = range(seed, seed + old["surfaces"].iloc[0])
        found, shifts = inverse_hardness(areas(nodes, waves, severity, seeds, **shape))
        error = 2 * np.sqrt((shifts**2).sum(axis=1)) / found["inverse"]
        yield old.assign(ratio=1 / found["inverse"].to_numpy(), error=error.to_numpy())


def compared(rows):
    """Return the ensembles of other spectra with the relative change of their hardness
    from that of the map's spectrum.

    The column `error` is the 95 % error of the change.
    """
    usual = (rows[SPECTRUM] == list(MAP)).all(axis=1)
    table = rows[~usual].merge(
        rows[usual], on=[*METAL, "first_seed"], suffixes=("", "_usual")
    )
    table["change"] = table["ratio"] / table["ratio_usual"] - 1
    table["breadth"] = table["waves"] / table["roll_off"]
    return table.assign(error=np.hypot(table["error"], table["error_usual"]))


def terms(table):
    """Return the two terms of the fitted change of the hardness, (n, 2).

    The first is ln(breadth / 4), weighted by severity / (8 + severity); the second is
    (1 - 4 / waves) / load, the effect of the number of waves.
    """
    flow = table["severity"] / (8 + table["severity"])
    size = (1 - 4 / table["waves"]) / table["load"]
    return np.column_stack([flow * np.log(table["breadth"] / 4), size])


def judged(rows):
    """Return the table of `compared` with the formula's value (`told`), its estimated
    error (`claimed`), whether both agree (`within`), and whether the fit used the row
    (`taught`).
    """
    table = compared(rows)
    spectra = pd.MultiIndex.from_frame(table[SPECTRUM])
    table["taught"] = (
        spectra.isin(FITTED) & (table["nodes"] == 6) & (table["poisson_ratio"] == 0.3)
    ) & (table["first_seed"] < 400)
    places = table[["breadth", "severity", "load"]].to_numpy()
    table[["told", "claimed"]] = [kept.breadth_correction(*place) for place in places]
    off = np.abs(table["change"] - table["told"])
    return table.assign(within=off <= np.hypot(table["claimed"], table["error"]))


def main():
    """Print the fit to the ensembles of FITTED, and the formula's value beside each
    other ensemble's.
    """
    rows = pd.read_csv(FILE)
    if sys.argv[1:2] == ["--solve"]:
        for table in solved(rows.query(sys.argv[2]) if sys.argv[2:] else rows):
            rows.update(table)
            rows.round(5).to_csv(FILE, index=False)
    table = judged(rows)
    one = table[table["taught"]]
    weight = 1 / np.hypot(one["error"], 0.02).to_numpy()
    t, w = np.linalg.lstsq(
        terms(one) * weight[:, None], one["change"] * weight, rcond=None
    )[0]
    print(
        f"t {t:.4f} and w {w:.4f} at 6 nodes to the shortest wave; "
        f"{kept.BREADTH_TREND}, {kept.SIZE_EFFECT} taken"
    )
    other = table[~table["taught"]]
    columns = [
        *METAL,
        *SPECTRUM,
        "surfaces",
        "change",
        "error",
        "told",
        "claimed",
        "within",
    ]
    print(other[columns].round(3).to_string(index=False))
    print(f"within the claim and the scatter: {other['within'].sum()} of {len(other)}")


if __name__ == "__main__":
    main()
