"""The conductance of rough joints: laws and fitted formula over boundary elements.

`conductance.csv` holds y = sigma h/(k_s m), means over surfaces, with the relative
half-width of their 95 % interval, which includes the error estimates of the grids;
`laboratory.conductance` computes it.
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
from epcontact.output.charts.plot import Axis, Plot
from epcontact.output.charts.style import DIFFERENCE_MAP
from epcontact.reference import conductance as laws
from epcontact.results import APART
from epcontact.scene import Load, Material, Scene
from epcontact.studies.frame import (
    Charts,
    Ints,
    Say,
    mean_with_interval,
    study,
    tabulate,
)
from epcontact.studies.paper_scene import self_affine

#: Hardness over E* xi, and loads over the hardness.
HARDNESSES = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
LOADS = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3)
#: Grid points per shortest wavelength.
POINTS = 4
#: Joints with fewer patches, on average over surfaces, are not compared with laws.
FEWEST = 10
PLACE = ["breadth", "hurst", "hardness", "load"]
FORMULA = "epcontact"
RATIO = "law_over_boundary_elements"
_BANDS = (0.5, 0.8, 0.9, 1.1, 1.2, 1.5)


def joint_scene(
    breadth: float, hurst: float, hardness: float, load: float, seed: int, waves: int
) -> Scene:
    """Return a joint of E* = xi = 1 and the period 1.

    Args:
        breadth: Wavelength of the roll-off over the shortest.
        hurst: Hurst exponent.
        hardness: Hardness over E* xi.
        load: Mean pressure over the hardness.
        seed: Seed of the surface.
        waves: Number of waves of the roll-off in a period.
    """
    shortest = round(breadth * waves)
    shape = (POINTS * shortest, POINTS * shortest)
    surface = self_affine(
        2 * math.pi,
        shape,
        seed,
        shortest,
        waves,
        hurst,
    )
    return Scene(surface, Material(1.0, 0.0, hardness), Load(load * hardness))


def measured(**place: Any) -> dict[str, float]:
    """Return the conductance of a `joint_scene` by boundary elements.

    `place` are the arguments of `joint_scene`.  The row has y = sigma h/(k_s m), where
    h is the conductance, sigma the rms height, k_s the harmonic mean of the
    conductivities and m the mean absolute slope, the `error_estimate` of y by its grid,
    and the number of `patches` of contact.
    """
    scene = joint_scene(**place)
    result = bem.solve(scene, threads=1)
    conductance = contact_conductance(scene, result, 2.0)
    unit = scene.surface.rms_height * laws.PROFILE
    patches = find_patches(result.fields["state"] != APART)
    return {
        "y": conductance.corrected * unit,
        "error_estimate": conductance.error * unit,
        "patches": patches.areas.size,
    }


def means(say: Say, **axes: Sequence[Any]) -> pd.DataFrame:
    """Return the conductances of joints, as means over their surfaces.

    Args:
        say: Called with the arguments before each solve.
        axes: Values of each argument of `joint_scene`, the seed among them.

    Returns:
        A row for each combination but the seed: the columns PLACE, `y` of `measured`,
        the relative `half_width` of its 95 % interval and the mean of `patches`.
    """
    table = tabulate(say, measured, **axes)
    found = mean_with_interval(table, "y", PLACE, "error_estimate")
    found["half_width"] = (found["y_high"] - found["y"]) / found["y"]
    return found[[*PLACE, "y", "half_width", "patches"]]


def table_of_package() -> pd.DataFrame:
    """Return the package's table of conductances, with the columns of `means`."""
    return pd.read_csv(str(files("epcontact.studies") / "conductance.csv"), comment="#")


def ratios(table: pd.DataFrame) -> pd.DataFrame:
    """Return the conductance by each law over that of boundary elements.

    Args:
        table: Rows of `means`; those with fewer patches than FEWEST are left out.

    Returns:
        The rows for each law, with its name in `law`, the ratio in the column RATIO
        (NaN where the law does not hold), and the ends of the ratio's 95 % interval in
        RATIO_low and RATIO_high.
    """
    table = table[table["patches"] >= FEWEST]
    load = table["load"].to_numpy()
    hardness = table["hardness"].to_numpy()
    formula = laws.fitted(load, hardness, table["breadth"].to_numpy())
    outside = laws.contact_area(load, hardness) > laws.FULL
    predicted = {name: law(load, hardness) for name, law in laws.LAWS.items()}
    predicted[FORMULA] = np.where(outside, np.nan, formula)
    tables = []
    for name, y in predicted.items():
        tables.append(table.assign(law=name, **{RATIO: y / table["y"]}))
    found = pd.concat(tables, ignore_index=True)
    found[f"{RATIO}_low"] = found[RATIO] * (1 - found["half_width"])
    found[f"{RATIO}_high"] = found[RATIO] * (1 + found["half_width"])
    return found


def law_map(table: pd.DataFrame) -> Any:
    """Return a matplotlib figure with a panel for each law.

    It has contours of the ratio of the law to boundary elements over hardness and load.
    `table` has the columns series (name of the law), hardness (over E* xi), load (over
    the hardness) and RATIO.
    """
    names = table["series"].unique()
    with styled():
        figure, panels = new_figure(1.2 + 2.6 * len(names), 3.3, columns=len(names))
        for axes, name in zip(panels, names, strict=True):
            rows = table[table["series"] == name]
            grid = rows.pivot_table(index="load", columns="hardness", values=RATIO)
            data = (grid.columns, grid.index, np.ma.masked_invalid(grid))
            filled = axes.contourf(
                *data, levels=_BANDS, cmap=DIFFERENCE_MAP, extend="both"
            )
            lines = axes.contour(
                *data,
                levels=_BANDS,
                colors="#333333",
                linewidths=0.8,
            )
            axes.clabel(lines, fontsize=7)
            axes.set(
                xscale="log",
                yscale="log",
                title=name,
                xlabel=r"hardness over $E^*\xi$ (–)",
            )
            axes.set_xlim(table["hardness"].min(), table["hardness"].max())
            axes.set_ylim(table["load"].min(), table["load"].max())
            for axis, column in ((axes.xaxis, "hardness"), (axes.yaxis, "load")):
                ticks = sorted(table[column].unique())
                axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
                axis.set_ticks([], minor=True)
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
    axes = {
        "hurst": hursts,
        "hardness": hardnesses,
        "seed": seeds,
        "waves": [waves],
    }
    middle = breadths[len(breadths) // 2]
    table = ratios(
        means(
            say,
            breadth=[middle],
            **axes,
            load=loads,
        )
    )
    names = {"law": "series", f"{RATIO}_low": "low", f"{RATIO}_high": "high"}
    columns = ["series", "hardness", RATIO, "low", "high", "load"]
    shown = table.dropna(subset=RATIO).rename(columns=names)[columns]
    caption = f"Where do the laws of conductance hold? The breadth is {middle:g}."
    yield law_map, shown, caption
    axes |= {"hardness": [min(hardnesses), max(hardnesses)]}
    table = ratios(
        means(
            say,
            breadth=breadths,
            **axes,
            load=[0.1],
        )
    )
    table["place"] = table["hardness"].map("{:g} E* xi".format)
    table = table[table["hurst"] == hursts[-1]]
    plot = Plot(
        Axis("breadth", "longest over shortest wave (–)"),
        Axis(RATIO, "law over boundary elements (–)"),
        ("law", "place"),
        level=1.0,
        colour="law",
        mark="place",
        log="x",
        ticks=breadths,
    )
    caption = (
        "Do the laws of conductance hold for broad spectra? "
        "The mean pressure is a tenth of the hardness."
    )
    yield plot, table, caption
