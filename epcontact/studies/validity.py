"""The study of where the theory holds: its error over the plane of load and
hardness.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from epcontact import persson
from epcontact.output.charts.figures import logarithmic, new_figure, styled
from epcontact.output.charts.style import DIFFERENCE_MAP, typeset
from epcontact.persson import validity
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.frame import Charts, Ints, Say, study
from epcontact.studies.paper_scene import GAMMA, LOWEST, MODULUS

#: Relative errors between the colours; the outermost colours have no end.
LEVELS = (-0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2)
#: The height at which the strip of a body without hardness is drawn, as hardness/(E*
#: xi).
_STRIP = (3.8, 5.2)
_OUTSIDE = "#bbbbbb"
_UNRESOLVED: Any = {"fc": "#dddddd", "ec": "#777777", "hatch": "////", "linewidth": 0}
_NOT = "not resolved by boundary elements"
_X, _Y = "pressure_over_slope_modulus", "hardness_over_slope_modulus"
_TITLES = {
    "total": "contact area",
    "elastic": "elastic area",
    "plastic": "plastic area",
}
_TITLES |= {"mean_gap": "mean gap", "wasserstein": "distance of P(σ)"}
_TITLES |= {"slope_at_zero": "slope of P(σ) at σ = 0"}


@study("validity", points=(64, 64))
def where_the_theory_holds(
    say: Say,
    points: Ints = (24, 32),
    hurst: float = 0.8,
    wide: float = 256.0,
    roll_off: float = 4.0,
) -> Charts:
    """Error of the theory over the plane of load and hardness, by the kept map.

    Boundary elements: 8 surfaces a place.  Strip: no hardness; dot: the scene of
    Almqvist and Persson.  Distances are Wasserstein's over the hardness, slopes means
    over a fifth of hardness or E* xi.
    """
    spectrum = SelfAffineSpectrum(hurst, LOWEST, roll_off * LOWEST, wide * LOWEST, 1.0)
    rough = persson.analytic_roughness(spectrum)
    reach, tables, reduction = validity.map_reach(), [], persson.EnergyReduction(GAMMA)
    hardnesses = np.geomspace(*reach["hardness/(E*ξ)"], num=points[0])
    low, high = (math.log(s / (1 - s)) for s in reach["p0/hardness"])
    shares = 1 / (1 + np.exp(-np.linspace(low, high, points[1])))
    loads = np.geomspace(*reach["p0/(E*ξ)"], num=points[1])
    for hardness in (*hardnesses, math.inf):
        for load in loads if math.isinf(hardness) else hardness * shares:
            body = persson.Theory(rough, MODULUS, reduction, hardness * MODULUS)
            found = validity.expected_errors(body, load * MODULUS)
            for name in _TITLES:
                low, middle, high = found.get(name, (math.nan,) * 3)
                tables.append((name, hardness, middle, low, high, load))
    columns = ["series", _Y, "relative_error", "low", "high", _X]
    table = pd.DataFrame(
        sorted(tables, key=lambda row: [*_TITLES].index(row[0])), columns=columns
    )
    alpha = validity.nayak(rough)[0]
    yield _drawn, table, f"Nayak's parameter {alpha:.3g}"


def _drawn(table: pd.DataFrame) -> Any:
    """Six panels of the plane, in bands of colour between LEVELS."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm
    from matplotlib.patches import Patch

    levels, rows = [-1.001, *LEVELS, 1.0], table[_Y].nunique()
    look: Any = {
        "cmap": DIFFERENCE_MAP,
        "norm": BoundaryNorm(levels, 256),
        "levels": levels,
    }
    with styled():
        figure, _ = new_figure(7.6, 5.6)
        figure.clear()
        panels = figure.subplots(2, 3, sharex=True, sharey=True)
        figures = table.groupby("series", sort=False)
        for axes, (name, known) in zip(panels.flat, figures, strict=True):
            x, y, e = (
                known[c].to_numpy().reshape(rows, -1)
                for c in (_X, _Y, "relative_error")
            )
            e = np.minimum(e, 0.999)
            edge = np.s_[:-1, 0], np.s_[-2::-1, -1]
            axes.fill(
                *(np.concatenate([v[i] for i in edge]) for v in (x, y)), **_UNRESOLVED
            )
            axes.contourf(x[:-1], y[:-1], e[:-1], **look)
            strip = np.broadcast_to(np.transpose([_STRIP]), (2, x.shape[1]))
            axes.contourf(np.tile(x[-1], (2, 1)), strip, np.tile(e[-1], (2, 1)), **look)
            axes.plot(0.05, 0.6, "o", color="black", markersize=4)
            axes.set(
                facecolor=_OUTSIDE, ylim=(y.min(), _STRIP[1]), title=_TITLES[str(name)]
            )
            for axis in "xy":
                logarithmic(axes, axis)
            marks = [".1", ".2", ".5", "1", "2", "none"]
            axes.set_yticks([0.1, 0.2, 0.5, 1, 2, sum(_STRIP) / 2], marks)
        for axes in panels.flat:
            axes.set_xlabel(
                typeset("load p0 / (E* xi) (–)"), visible=axes in panels[-1]
            )
            axes.set_ylabel(
                typeset("hardness / (E* xi) (–)"), visible=axes in panels[:, 0]
            )
        bar = figure.colorbar(
            ScalarMappable(look["norm"], look["cmap"]),
            ax=panels,
            location="bottom",
            ticks=LEVELS,
            format=lambda v, _: f"{100 * v:+g}",
            aspect=50,
            shrink=0.8,
        )
        bar.set_label("relative error of the theory (%)")
        keys = (
            Patch(facecolor=_OUTSIDE, label="outside the map"),
            Patch(**_UNRESOLVED, label=_NOT),
        )
        figure.legend(handles=keys, loc="outside lower center", ncols=2)
    return figure
