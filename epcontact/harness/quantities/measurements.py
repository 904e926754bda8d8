"""Quantities that are measured of the surface, the fields and the interface with numpy
alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from epcontact import interface
from epcontact.harness.gates import carried_pressure
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.reference import roughness
from epcontact.results import APART, ELASTIC, PLASTIC

# --- the surface: another seed, or the surface turned round, would change these
# ------------------


@quantity("m", needs=())
def surface_rms_height(a: SolvedScene) -> float:
    """rms height of the surface."""
    return a.scene.surface.rms_height


@quantity("–", needs=())
def surface_rms_slope(a: SolvedScene) -> float:
    """rms slope of the surface by spectral derivatives."""
    return roughness.rms_slope(a.scene)


@quantity("m", needs=())
def surface_highest(a: SolvedScene) -> float:
    """height of the highest point over the mean."""
    heights = a.scene.surface.heights
    return float((heights - heights.mean()).max())


@quantity("–", needs=())
def surface_skewness(a: SolvedScene) -> float:
    """skewness of the heights: of the other sign upside down."""
    above = a.scene.surface.heights - a.scene.surface.heights.mean()
    return float((above**3).mean() / (above**2).mean() ** 1.5)


def _summit(a: SolvedScene) -> tuple[int, ...]:
    heights = a.scene.surface.heights
    return tuple(
        int(i) for i in np.unravel_index(int(np.argmax(heights)), heights.shape)
    )


@quantity("–", needs=(), name="surface_summit_{}", each={"x": "x", "y": "y"})
def summit(a: SolvedScene, axis: str) -> float:
    """place of the highest point along {}, over the period."""
    number = "xy".index(axis)
    return float(_summit(a)[number] / a.scene.surface.shape[number])


@quantity("1/m", needs=())
def surface_curvature(a: SolvedScene) -> float:
    """curvature at the highest point by differences, mean over the axes."""
    surface, summit, curvatures = a.scene.surface, _summit(a), []
    for axis, d in enumerate(surface.spacing):
        beside = [np.roll(surface.heights, shift, axis)[summit] for shift in (1, -1)]
        curvatures.append((2 * surface.heights[summit] - sum(beside)) / d**2)
    return float(np.mean(curvatures))


# --- the fields and the distribution
# -------------------------------------------------------------


@quantity("–")
def measured_force(a: SolvedScene) -> float:
    """mean(p)/p0 - 1.

    After a path to zero load it is mean(p) over the largest mean pressure.
    """
    return (float(a.pressure.mean()) - a.scene.load.final) / a.load_scale


@quantity("–")
def measured_bounds(a: SolvedScene) -> float:
    """largest distance of p from [0, hardness], over p0."""
    beyond = float(a.pressure.max()) - a.scene.material.hardness
    return max(-float(a.pressure.min()), beyond, 0.0) / a.load_scale


@quantity("–")
def measured_gap(a: SolvedScene) -> float:
    """largest violation of the contact conditions (Karush-Kuhn-Tucker) over the rms height:
    |g| where 0 < p < hardness, -g where p = 0, g where p = hardness.

    After a path that unloads, the surface is the one that the reported plastic
    displacement has left, on which every contact is elastic.
    """
    p, (gap, touching) = a.pressure, a.open_gap
    wrong = [
        np.abs(gap[touching]).max(initial=0.0),
        -gap[p <= 0].min(initial=0.0),
        gap[a.at_the_cap & ~touching].max(initial=0.0),
    ]
    return float(np.max(wrong)) / a.height_scale


@quantity("–")
def measured_raw_total(a: SolvedScene) -> float:
    """share of grid points with p > 0, less the raw area."""
    return float((a.pressure > 0).mean()) - a.result.final.areas["raw"].total


@quantity("–")
def measured_raw_plastic(a: SolvedScene) -> float:
    """share of grid points at the hardness, less the raw plastic area."""
    return float(a.at_the_cap.mean()) - a.result.final.areas["raw"].plastic


@quantity("–")
def measured_carried(a: SolvedScene) -> float:
    """(int sigma dF + hardness A_pl)/p0 - 1 of the reported distribution."""
    carried, hardness = carried_pressure(a.distribution), a.scene.material.hardness
    if math.isfinite(hardness):
        carried += hardness * a.distribution.plastic
    return (carried - a.scene.load.final) / a.load_scale


@quantity("Pa")
def smallest_contact_pressure(a: SolvedScene) -> float:
    """smallest pressure where p > 0."""
    touching = a.pressure > 0
    return float(a.pressure[touching].min()) if touching.any() else 0.0


# --- the interface under load
# --------------------------------------------------------------------

_KINDS = {
    "": "in the limit of a vanishing grid spacing",
    ".raw": "as the grid's own points have it",
    ".error": "the estimated absolute error of the limit",
}
#: How far a grid of four points a shortest wave was off one of 32: the median, and nine
#: in ten, of 48 rough surfaces.
_NUMBERS = {
    "total": "total contact; no claim: 4 points a shortest wave are off by 7 %, one in ten by 18 %",
    "elastic": "elastic contact; no claim: a coarse grid breaks its seams, or does not see them",
    "plastic": "plastic contact; no claim: 4 points are off by 13 %, or see few where little flows",
}
_LARGEST = {
    "total": "total contact; no claim: 4 points a shortest wave are off by 4 %, one in ten by 11 %",
    "elastic": "elastic contact; no claim: 4 points are off by 12 %, one in ten by several times",
    "plastic": "plastic contact; no claim: 4 points are off by 12 %, one in ten by 70 %",
}
Limit = Callable[[SolvedScene], interface.Limit]


def _limit(unit: str) -> Callable[[Limit], Limit]:
    """Add three quantities: what a function of an answered scene returns, raw, and its
    error.
    """

    def add(measure: Limit) -> Limit:
        def of_kind(a: SolvedScene, kind: str) -> float:
            return float(
                getattr(a.once(measure), kind.removeprefix(".") or "corrected")
            )

        meaning = (measure.__doc__ or "").strip().removesuffix(".")
        of_kind.__doc__ = f"{meaning}, {{}}."
        quantity(unit, name=f"{measure.__name__}{{}}", each=_KINDS)(of_kind)
        return measure

    return add


@_limit("Pa/m")
def stiffness_loading(a: SolvedScene) -> interface.Limit:
    """d(mean pressure)/d(approach of the mean planes) if the load grows next."""
    if a.flows:  # a J2 body hardens where it flows, and by how much two more loads tell
        return interface.Limit(math.nan, math.nan, math.nan)
    if not (a.field("state") == PLASTIC).any():  # all of the contact answers either way
        return a.once(stiffness_unloading)
    return interface.interface_stiffness(a.scene, a.result, "loading")


@_limit("Pa/m")
def stiffness_unloading(a: SolvedScene) -> interface.Limit:
    """d(mean pressure)/d(approach of the mean planes) if the load falls next."""
    return interface.interface_stiffness(a.scene, a.result, "unloading")


@_limit("1/m")
def conductance(a: SolvedScene) -> interface.Limit:
    """contact conductance per nominal area times the sum of the bodies'
    resistivities.
    """
    return interface.contact_conductance(
        a.scene, a.result, 1.0, a.once(stiffness_unloading)
    )


def _patches(a: SolvedScene, part: str) -> Any:
    state = a.field("state")
    masks = {
        "total": state != APART,
        "elastic": state == ELASTIC,
        "plastic": state == PLASTIC,
    }
    return interface.find_patches(masks[part]).areas


@quantity("–", name="{}_patches", each=_NUMBERS)
def patches(a: SolvedScene, part: str) -> float:
    """number of connected patches of {}."""
    return float(_patches(a, part).size)


@quantity("–", name="{}_patches_largest", each=_LARGEST)
def largest_patch(a: SolvedScene, part: str) -> float:
    """share of the nominal area in the largest patch of {}."""
    return float(_patches(a, part).max(initial=0.0))


def _closeness(a: SolvedScene) -> Any:
    p, gap, height = (
        a.pressure,
        a.field("gap"),
        np.ptp(a.scene.surface.heights) or a.height_scale,
    )
    if "plastic_displacement" in a.result.fields and not a.flows:
        gap = gap + np.where(a.at_the_cap, 0.0, a.field("plastic_displacement"))
    # At the hardness all pressures are equal, and the points that have flowed furthest
    # are closest.
    loose = (p <= 0) | (a.at_the_cap & (not a.flows))
    return p / (p.max() or 1.0) - np.where(loose, gap / height, 0.0)


@_limit("–")
def contact_percolation(a: SolvedScene) -> interface.Limit:
    """share of the nominal area, the closest points first, that first connects across a
    period.
    """
    return interface.percolation_fraction(_closeness(a))


@_limit("–")
def gap_percolation(a: SolvedScene) -> interface.Limit:
    """share of the nominal area, the widest gaps first, that first connects across a
    period.
    """
    return interface.percolation_fraction(-_closeness(a))
