"""What rough joints conduct: the laws of textbooks, and the fitted formula, over
boundary elements.

`conductance.csv` keeps y = sigma h/(k_s m), means over surfaces, with the relative
half-width of their 95 % interval, in which the claims of the grids are;
`laboratory.conductance` makes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.interface import contact_conductance, find_patches
from epcontact.output.charts.figures import new_figure, styled
from epcontact.output.charts.plot import Plot
from epcontact.output.charts.style import DIFFERENCE_MAP
from epcontact.reference import conductance as laws
from epcontact.results import APART
from epcontact.scene import Load, Material, Scene
from epcontact.studies.frame import Charts, Ints, Say, mean_with_interval, rows, study
from epcontact.studies.paper_scene import self_affine

HARDNESSES, LOADS = (
    (0.03, 0.06, 0.12, 0.25, 0.5, 1.0),
    (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3),
)
POINTS = 4  # of the grid per shortest wave
FEWEST = 10  # patches of a joint, on average, that count as many
PLACE = ["breadth", "hurst", "hardness", "load"]
FORMULA, RATIO = "epcontact", "law_over_boundary_elements"
_BANDS = (0.5, 0.8, 0.9, 1.1, 1.2, 1.5)


def joint_scene(
    breadth: float, hurst: float, hardness: float, load: float, seed: int, waves: int
) -> Scene:
    """A joint of E* = xi = 1 and the period 1, on which so many waves of the roll-off
    fit.
    """
    high = round(breadth * waves)
    surface = self_affine(2 * math.pi, (POINTS * high,) * 2, seed, high, waves, hurst)
    return Scene(surface, Material(1.0, 0.0, hardness), Load(load * hardness))


def measured(**place: Any) -> dict[str, float]:
    """y of one joint by boundary elements, the claim of its grid, and the number of its
    patches.
    """
    scene = joint_scene(**place)
    result = bem.solve(scene, threads=1)
    found, unit = (
        contact_conductance(scene, result, 2.0),
        scene.surface.rms_height * laws.PROFILE,
    )
    count = find_patches(result.fields["state"] != APART).areas.size
    return {"y": found.corrected * unit, "claim": found.error * unit, "patches": count}


def means(say: Say, **axes: Sequence[Any]) -> pd.DataFrame:
    """A row for each place: y with its interval, and the mean number of patches."""
    found = mean_with_interval(rows(say, measured, **axes), "y", PLACE, "claim")
    found["half_width"] = (found["y_high"] - found["y"]) / found["y"]
    return found[[*PLACE, "y", "half_width", "patches"]]


def kept() -> pd.DataFrame:
    """The table of the package."""
    return pd.read_csv(str(files("epcontact.studies") / "conductance.csv"), comment="#")


def ratios(table: pd.DataFrame) -> pd.DataFrame:
    """Every law over the measured y, a row for each law and place of many patches, with
    bounds.
    """
    table = table[table["patches"] >= FEWEST]
    at = {name: table[name].to_numpy() for name in PLACE}
    said = {name: law(at["load"], at["hardness"]) for name, law in laws.LAWS.items()}
    full = laws.contact_area(at["load"], at["hardness"]) > laws.FULL
    said[FORMULA] = np.where(
        full, np.nan, laws.fitted(at["load"], at["hardness"], at["breadth"])
    )
    each = [
        table.assign(law=name, **{RATIO: y / table["y"]}) for name, y in said.items()
    ]
    found = pd.concat(each, ignore_index=True)
    for end, sign in (("low", -1), ("high", 1)):
        found[f"{RATIO}_{end}"] = found[RATIO] * (1 + sign * found["half_width"])
    return found


def law_map(table: pd.DataFrame) -> Any:
    """Contours of each law over the solver in the plane of hardness and load."""
    names = table["series"].unique()
    with styled():
        figure, panels = new_figure(1.2 + 2.6 * len(names), 3.3, columns=len(names))
        for axes, name in zip(panels, names, strict=True):
            mine = table[table["series"] == name]
            grid = mine.pivot_table(index="load", columns="hardness", values=RATIO)
            at = (grid.columns, grid.index, np.ma.masked_invalid(grid))
            filled = axes.contourf(
                *at, levels=_BANDS, cmap=DIFFERENCE_MAP, extend="both"
            )
            lines = axes.contour(*at, levels=_BANDS, colors="#333333", linewidths=0.8)
            axes.clabel(lines, fontsize=7)
            axes.set(
                xscale="log",
                yscale="log",
                title=name,
                xlabel=r"hardness over $E^*\xi$ (–)",
            )
            for axis, values in (("x", table["hardness"]), ("y", table["load"])):
                axes.set(**{f"{axis}lim": (values.min(), values.max())})
                ticks = sorted(values.unique())
                getattr(axes, f"{axis}axis").set_ticks(
                    ticks, [f"{tick:g}" for tick in ticks]
                )
                getattr(axes, f"{axis}axis").set_ticks([], minor=True)
        panels[0].set_ylabel("mean pressure over hardness (–)")
        figure.colorbar(filled, ax=list(panels), label="law over boundary elements (–)")
    return figure


@study(
    "conductance",
    hursts=(0.3, 0.6, 0.8, 0.9),
    breadths=(2, 4, 8, 16, 32),
    seeds=range(1, 17),
    hardnesses=HARDNESSES,
    loads=LOADS,
    waves=8,
)
def conductance(
    say: Say,
    hursts: Sequence[float] = (0.8,),
    breadths: Sequence[float] = (2, 8),
    hardnesses: Sequence[float] = HARDNESSES[::2],
    loads: Sequence[float] = LOADS[1::2],
    seeds: Ints = range(1, 5),
    waves: int = 8,
) -> Charts:
    """The laws of contact conductance over boundary elements, and where they hold.

    Laws are Cooper, Mikic and Yovanovich's for flow, Mikic's and Persson's for elastic
    joints, and the fitted formula of `epcontact joint`.  The breadth is the wave number
    of the highest waves over that of the roll-off, and so many waves of the roll-off
    fit on the period.
    """
    axes = {"hurst": hursts, "hardness": hardnesses, "seed": seeds, "waves": [waves]}
    middle = breadths[len(breadths) // 2]
    table = ratios(means(say, breadth=[middle], **axes, load=loads)).dropna(
        subset=RATIO
    )
    names = {"law": "series", f"{RATIO}_low": "low", f"{RATIO}_high": "high"}
    shown = table.rename(columns=names)[
        ["series", "hardness", RATIO, "low", "high", "load"]
    ]
    yield law_map, shown, f"Laws over boundary elements at a breadth of {middle:g}"
    axes |= {"hardness": [min(hardnesses), max(hardnesses)]}
    table = ratios(means(say, breadth=breadths, **axes, load=[0.1]))
    table["place"] = table["hardness"].map(r"{:g} $E^*\xi$".format)
    table = table[table["hurst"] == hursts[-1]]
    x, y = (
        ("breadth", "longest over shortest wave (–)"),
        (RATIO, "law over boundary elements (–)"),
    )
    look: Any = {"colour": "law", "mark": "place", "log": "x", "ticks": breadths}
    plot = Plot(x, y, ("law", "place"), level=1.0, **look)
    yield plot, table, "Laws by the breadth of the spectrum, at a tenth of the hardness"
