"""The study of where the theory holds: its error over load and hardness."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from epcontact import persson
from epcontact.output.charts.figures import logarithmic, new_figure, styled
from epcontact.output.charts.style import DIFFERENCE_MAP, typeset
from epcontact.persson import validity
from epcontact.persson.near_bounds import CONSTANTS
from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.frame import Charts, Ints, Say, study
from epcontact.studies.paper_scene import GAMMA, LOWEST, MODULUS

#: Relative errors between the colours; the outermost colours have no end.
LEVELS = (-0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2)
#: Ends of hardness/(E* xi) between which a body without hardness is drawn.
_STRIP = (3.8, 5.2)
_OUTSIDE = "#bbbbbb"
_UNRESOLVED: Any = {
    "fc": "#dddddd",
    "ec": "#777777",
    "hatch": "////",
    "linewidth": 0,
}
_X = "pressure_over_slope_modulus"
_Y = "hardness_over_slope_modulus"
#: The quantities of the map that are drawn, with the titles of their panels.
_TITLES = {
    "total": "contact area",
    "elastic": "elastic area",
    "plastic": "plastic area",
    "mean_gap": "mean gap",
    "wasserstein": "distance of P(σ)",
    "slope_at_zero": "slope of P(σ) at σ = 0",
}


#: Those whose error the map has for the rule "near_bounds".
_OF_NEAR_BOUNDS = ["total", "elastic", "plastic", "mean_gap"]


@study("validity", points=(64, 64))
def where_the_theory_holds(
    say: Say,
    points: Ints = (24, 32),
    hurst: float = 0.8,
    wide: float = 256.0,
    roll_off: float = 4.0,
) -> Charts:
    """Error of the theory over the plane of load and hardness, by the package's map.

    Boundary elements: 8 surfaces a place.  Strip: no hardness; dot: the scene of
    Almqvist and Persson.  Distances are Wasserstein's over the hardness, slopes means
    over a fifth of hardness or E* xi.
    """
    spectrum = SelfAffineSpectrum(hurst, LOWEST, roll_off * LOWEST, wide * LOWEST, 1.0)
    rough = persson.analytic_roughness(spectrum)
    alpha, _ = validity.nayak(rough)
    of_paper = persson.EnergyReduction(GAMMA)
    near_bounds = persson.EnergyReduction(CONSTANTS[0], "near_bounds")
    places = list(_places(*points))
    for reduction, names in ((of_paper, list(_TITLES)), (near_bounds, _OF_NEAR_BOUNDS)):
        say(f"rule {reduction.rule}")
        rows = []
        for hardness, loads in places:
            body = persson.Theory(rough, MODULUS, reduction, hardness * MODULUS)
            for load in loads:
                errors = validity.expected_errors(body, load * MODULUS)
                for name in names:
                    low, middle, high = errors.get(name, (math.nan, math.nan, math.nan))
                    rows.append((name, hardness, middle, low, high, load))
        rows.sort(key=lambda row: list(_TITLES).index(row[0]))
        columns = ["series", _Y, "relative_error", "low", "high", _X]
        caption = (
            f"Where does the theory hold with the rule {reduction.rule}? Nayak's "
            f"parameter is {alpha:.3g}."
        )
        yield _draw, pd.DataFrame(rows, columns=columns), caption


def _places(hardnesses: int, loads: int) -> Iterator[tuple[float, FloatArray]]:
    """Yield each hardness of the map over E* xi, with the loads over E* xi there.

    The last hardness is infinite.  `hardnesses` is the number of finite hardnesses, and
    `loads` the number of loads for each hardness.
    """
    reach = validity.map_reach()
    lowest, highest = reach["p0/hardness"]
    logits = np.linspace(
        math.log(lowest / (1 - lowest)), math.log(highest / (1 - highest)), loads
    )
    load_over_hardness = 1 / (1 + np.exp(-logits))
    for hardness in np.geomspace(*reach["hardness/(E*ξ)"], num=hardnesses):
        yield float(hardness), hardness * load_over_hardness
    yield math.inf, np.geomspace(*reach["p0/(E*ξ)"], num=loads)


def _draw(table: pd.DataFrame) -> Any:
    """Return a matplotlib figure with a panel for each quantity of the map.

    `table` has the columns of the study: series (name of the quantity), load and
    hardness over E* xi, and relative_error, which is drawn in bands of colour.
    """
    from matplotlib.colors import BoundaryNorm

    levels = [-1.001, *LEVELS, 1.0]
    norm = BoundaryNorm(levels, 256)
    look: dict[str, Any] = {
        "cmap": DIFFERENCE_MAP,
        "norm": norm,
        "levels": levels,
    }
    with styled():
        figure, _ = new_figure(7.6, 5.6)
        figure.clear()
        columns = math.ceil(table["series"].nunique() / 2)
        panels = figure.subplots(2, columns, sharex=True, sharey=True)
        groups = table.groupby("series", sort=False)
        for axes, (name, rows) in zip(panels.flat, groups, strict=True):
            _draw_panel(axes, rows, look)
            axes.set_title(_TITLES[str(name)])
        for axes in panels[-1]:
            axes.set_xlabel(typeset("load p0 / (E* xi) (–)"))
        for axes in panels[:, 0]:
            axes.set_ylabel(typeset("hardness / (E* xi) (–)"))
        _add_legends(figure, panels, norm)
    return figure


def _draw_panel(
    axes: Any,
    rows: pd.DataFrame,
    look: dict[str, Any],
) -> None:
    """Draw the relative error of one quantity of the map over load and hardness.

    Args:
        axes: The matplotlib axes.
        rows: Rows of this quantity, in the order of hardness and load.
        look: Colours and levels, arguments of `contourf`.
    """
    hardnesses = rows[_Y].nunique()
    x = rows[_X].to_numpy().reshape(hardnesses, -1)
    y = rows[_Y].to_numpy().reshape(hardnesses, -1)
    error = rows["relative_error"].to_numpy().reshape(hardnesses, -1)
    error = np.minimum(error, 0.999)
    # The outline of the map; the last row is the body without hardness.
    left = np.s_[:-1, 0]
    right = np.s_[-2::-1, -1]
    outline_x = np.concatenate([x[left], x[right]])
    outline_y = np.concatenate([y[left], y[right]])
    axes.fill(outline_x, outline_y, **_UNRESOLVED)
    axes.contourf(x[:-1], y[:-1], error[:-1], **look)
    strip_y = np.broadcast_to(np.transpose([_STRIP]), (2, x.shape[1]))
    axes.contourf(np.tile(x[-1], (2, 1)), strip_y, np.tile(error[-1], (2, 1)), **look)
    axes.plot(0.05, 0.6, "o", color="black", markersize=4)
    axes.set(facecolor=_OUTSIDE, ylim=(y.min(), _STRIP[1]))
    for axis in "xy":
        logarithmic(axes, axis)
    middle_of_strip = sum(_STRIP) / 2
    labels = [".1", ".2", ".5", "1", "2", "none"]
    axes.set_yticks([0.1, 0.2, 0.5, 1, 2, middle_of_strip], labels)


def _add_legends(figure: Any, panels: Any, norm: Any) -> None:
    """Add the colour bar and the legend of the areas without an error to a figure.

    Args:
        figure: The matplotlib figure.
        panels: Its axes.
        norm: Maps relative errors to colours.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.patches import Patch

    bar = figure.colorbar(
        ScalarMappable(norm, DIFFERENCE_MAP),
        ax=panels,
        location="bottom",
        ticks=LEVELS,
        format=lambda value, _: f"{100 * value:+g}",
        aspect=50,
        shrink=0.8,
    )
    bar.set_label("relative error of the theory (%)")
    outside = Patch(facecolor=_OUTSIDE, label="outside the map")
    unresolved = Patch(**_UNRESOLVED, label="not resolved by boundary elements")
    figure.legend(handles=(outside, unresolved), loc="outside lower center", ncols=2)
