"""The map of the effective hardness: the paths of its case file, the caps, the file and a chart.

One load path of a J2 body passes every load of the map, and boundary elements capped at a ladder
of hardnesses answer each of these loads on the same elements' compliance.  The paths are sweeps of
the cases in `cases/hardness-map.toml`; `hardness_fit` makes the map from the areas.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from epcontact.materials.hardness_map import (
    FULL,
    SYMBOLS,
    fitted_ratio,
    formula_text,
    hardness_map,
)
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.studies.hardness import TABOR
from epcontact.studies.tables import Progress, Size

#: The file of cases that came with the package, whatever the folder ./cases holds.
CASES = "hardness-map"
#: Caps over the yield stress that are tried, besides none.
LADDER = tuple(1.08**k for k in range(21))


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Draw the kept map, one chart for each Poisson's ratio."""
    del size, progress
    known = pd.DataFrame(dict(hardness_map()))
    return tuple(draw_map(part) for _, part in known.groupby("poisson_ratio"))


def draw_map(known: pd.DataFrame) -> Chart:
    """Draw the map at one Poisson's ratio, with the formula."""
    nu = float(known["poisson_ratio"].iloc[0])
    known = known[(known["area"] <= FULL) & (known["inverse_hardness"] > 0)]
    parts = ("scatter", "grid_error", "steps_error", "depth_error")
    error = np.sqrt(sum(known[part] ** 2 for part in parts))
    inverse, name = (
        known["inverse_hardness"],
        known["severity"].map("E* xi / sigma_Y = {:g}".format),
    )
    columns = {
        "colour": known["severity"],
        "load": known["load"],
        "effective_hardness": 1 / inverse,
    }
    bounds = {
        "effective_hardness_low": 1 / (inverse * (1 + error)),
        "effective_hardness_high": 1 / (inverse * np.maximum(1 - error, 0.5)),
    }
    fit = fitted_ratio(*(known[axis].to_numpy() for axis in SYMBOLS))
    tables = [
        pd.DataFrame(columns | bounds | {"series": name, "style": "marks"}),
        pd.DataFrame(
            columns
            | {
                "effective_hardness": fit,
                "series": name.str.replace("E* xi / sigma_Y = ", "") + ", formula",
                "style": "curve",
            }
        ),
    ]
    return draw_table(
        pd.concat(tables),
        Plot(
            ("load", "p0 / sigma_Y (–)"),
            ("effective_hardness", "effective hardness c = hardness / sigma_Y (–)"),
            colour="colour",
            log="x",
            ticks=sorted(known["load"].unique()),
            level=TABOR,
        ),
        f"The effective hardness of rough J2 metals of Poisson's ratio {nu:g}: the cap, in yield "
        "stresses, under which capped boundary elements carry the load on the J2 body's area. "
        "Bars: 95 % intervals for the spectrum of the map; other spectra change it by "
        f"{100 * known['spectrum_error'].iloc[0]:.0f} % (95 %). "
        f"Curves: {formula_text()}. Dotted: 3, Tabor's rule. Places of a contact area above "
        f"{FULL:g} are left out.",
    )
