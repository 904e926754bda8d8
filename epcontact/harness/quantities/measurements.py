"""Quantities that are measured of the surface, the fields and the interface with numpy
alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from epcontact import interface
from epcontact.bem.workers import Workers
from epcontact.harness.gates import carried_pressure
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene, row_blocks
from epcontact.reference import roughness
from epcontact.results import APART, ELASTIC, PLASTIC

# --- the surface: another seed, or the surface turned round, would change these


@quantity("m", needs=())
def surface_rms_height(solved: SolvedScene) -> float:
    """rms height of the surface."""
    return solved.scene.surface.rms_height


@quantity("–", needs=())
def surface_rms_slope(solved: SolvedScene) -> float:
    """rms slope of the surface by spectral derivatives."""
    return roughness.rms_slope(solved.scene)


@quantity("m", needs=())
def surface_highest(solved: SolvedScene) -> float:
    """height of the highest point over the mean."""
    heights = solved.scene.surface.heights
    return float((heights - heights.mean()).max())


@quantity("–", needs=())
def surface_skewness(solved: SolvedScene) -> float:
    """skewness of the heights: of the other sign upside down."""
    above = solved.scene.surface.heights - solved.scene.surface.heights.mean()
    return float((above**3).mean() / (above**2).mean() ** 1.5)


def _summit(solved: SolvedScene) -> tuple[int, ...]:
    """Return the grid indices of the highest point, one for each axis of the grid."""
    heights = solved.scene.surface.heights
    indices = np.unravel_index(int(np.argmax(heights)), heights.shape)
    return tuple(int(index) for index in indices)


@quantity("–", needs=(), name="surface_summit_{}", each={"x": "x", "y": "y"})
def summit(solved: SolvedScene, axis: str) -> float:
    """place of the highest point along {}, over the period."""
    number = "xy".index(axis)
    return float(_summit(solved)[number] / solved.scene.surface.shape[number])


@quantity("1/m", needs=())
def surface_curvature(solved: SolvedScene) -> float:
    """curvature at the highest point by differences, mean over the axes."""
    surface = solved.scene.surface
    summit = _summit(solved)
    curvatures = []
    for axis, d in enumerate(surface.spacing):
        beside = [np.roll(surface.heights, shift, axis)[summit] for shift in (1, -1)]
        curvatures.append((2 * surface.heights[summit] - sum(beside)) / d**2)
    return float(np.mean(curvatures))


# --- the fields and the distribution


@quantity("–")
def measured_force(solved: SolvedScene) -> float:
    """mean(p)/p0 - 1.

    After a path to zero load it is mean(p) over the largest mean pressure.
    """
    return (float(solved.pressure.mean()) - solved.scene.load.final) / solved.load_scale


@quantity("–")
def measured_bounds(solved: SolvedScene) -> float:
    """largest distance of p from [0, hardness], over p0."""
    beyond = float(solved.pressure.max()) - solved.scene.material.hardness
    return max(-float(solved.pressure.min()), beyond, 0.0) / solved.load_scale


@quantity("–")
def measured_gap(solved: SolvedScene) -> float:
    """largest violation of the Karush-Kuhn-Tucker conditions over the rms height:
    |g| where 0 < p < hardness, -g where p = 0, g where p = hardness.

    After a path that unloads, the surface is the one that the reported plastic
    displacement has left, on which every contact is elastic.
    """
    p, (gap, touching) = solved.pressure, solved.open_gap
    wrong = [0.0]
    for rows in row_blocks(p):
        of_block, elastic = gap[rows], touching[rows]
        flowing = solved.at_the_cap[rows] & ~elastic
        wrong.append(np.abs(of_block[elastic]).max(initial=0.0))
        wrong.append(-of_block[p[rows] <= 0].min(initial=0.0))
        wrong.append(of_block[flowing].max(initial=0.0))
    return float(np.max(wrong)) / solved.height_scale


@quantity("–")
def measured_raw_total(solved: SolvedScene) -> float:
    """share of grid points with p > 0, less the raw area."""
    return float((solved.pressure > 0).mean()) - solved.result.final.areas["raw"].total


@quantity("–")
def measured_raw_plastic(solved: SolvedScene) -> float:
    """share of grid points at the hardness, less the raw plastic area."""
    return float(solved.at_the_cap.mean()) - solved.result.final.areas["raw"].plastic


@quantity("–")
def measured_carried(solved: SolvedScene) -> float:
    """(int sigma dF + hardness A_pl)/p0 - 1 of the reported distribution."""
    carried = carried_pressure(solved.distribution)
    hardness = solved.scene.material.hardness
    if math.isfinite(hardness):
        carried += hardness * solved.distribution.plastic
    return (carried - solved.scene.load.final) / solved.load_scale


@quantity("Pa")
def smallest_contact_pressure(solved: SolvedScene) -> float:
    """smallest pressure where p > 0."""
    touching = solved.pressure > 0
    return float(solved.pressure[touching].min()) if touching.any() else 0.0


# --- the interface under load

#: What of a limit a quantity is, by the end of its name.
_KINDS = {
    "": "in the limit of a vanishing grid spacing",
    ".raw": "as the grid's own points have it",
    ".error": "the estimated absolute error of the limit",
}
#: How far a grid of four points a shortest wave was off one of 32: the median, and nine
#: in ten, of 48 rough surfaces.
_NUMBERS = {
    "total": "total contact; no error estimate: 4 points a shortest wave are off by "
    "7 %, one in ten by 18 %",
    "elastic": "elastic contact; no error estimate: a coarse grid breaks its seams, or "
    "does not see them",
    "plastic": "plastic contact; no error estimate: 4 points are off by 13 %, or see "
    "few where little flows",
}
_LARGEST = {
    "total": "total contact; no error estimate: 4 points a shortest wave are off by "
    "4 %, one in ten by 11 %",
    "elastic": "elastic contact; no error estimate: 4 points are off by 12 %, one in "
    "ten by several times",
    "plastic": "plastic contact; no error estimate: 4 points are off by 12 %, one in "
    "ten by 70 %",
}
Limit = Callable[[SolvedScene], interface.Limit]


def _limit(unit: str) -> Callable[[Limit], Limit]:
    """Return the decorator that adds three quantities of a function to `QUANTITIES`.

    The decorated function returns an `interface.Limit`, a value extrapolated to a
    vanishing grid spacing.  The three quantities are this value, the value `.raw` on
    the grid itself, and the estimated absolute `.error`.

    Args:
        unit: of the three quantities.
    """

    def add(measure: Limit) -> Limit:
        """Add the three quantities of a function, and return the function itself."""

        def of_kind(solved: SolvedScene, kind: str) -> float:
            """Return the value of kind "" (the limit), ".raw" or ".error"."""
            attribute = kind.removeprefix(".") or "corrected"
            return float(getattr(solved.once(measure), attribute))

        meaning = (measure.__doc__ or "").strip().removesuffix(".")
        of_kind.__doc__ = f"{meaning}, {{}}."
        quantity(unit, name=f"{measure.__name__}{{}}", each=_KINDS)(of_kind)
        return measure

    return add


def _stiffness(solved: SolvedScene, branch: interface.Branch) -> interface.Limit:
    """Return the stiffness in Pa/m of one branch, "loading" or "unloading"."""
    return interface.interface_stiffness(
        solved.scene, solved.result, branch, solved.threads
    )


@_limit("Pa/m")
def stiffness_loading(solved: SolvedScene) -> interface.Limit:
    """d(mean pressure)/d(approach of the mean planes) if the load grows next."""
    if solved.flows:
        # A J2 body hardens where it flows; only two more loads would show how much.
        return interface.Limit(math.nan, math.nan, math.nan)
    if not (solved.field("state") == PLASTIC).any():
        # Elastic contact is as stiff while the load grows as while it falls.
        return solved.once(stiffness_unloading)
    return _stiffness(solved, "loading")


@_limit("Pa/m")
def stiffness_unloading(solved: SolvedScene) -> interface.Limit:
    """d(mean pressure)/d(approach of the mean planes) if the load falls next."""
    return _stiffness(solved, "unloading")


@_limit("1/m")
def conductance(solved: SolvedScene) -> interface.Limit:
    """contact conductance per nominal area times the sum of the bodies'
    resistivities.
    """
    return interface.contact_conductance(
        solved.scene, solved.result, 1.0, solved.once(stiffness_unloading)
    )


def _patches(solved: SolvedScene, part: str) -> Any:
    """Return the area of each connected patch of contact, an array of fractions of the
    nominal area.

    `part` is "total" contact, "elastic" or "plastic".  Raises InvalidCase without the
    field of states.
    """
    state = solved.field("state")
    masks = {
        "total": state != APART,
        "elastic": state == ELASTIC,
        "plastic": state == PLASTIC,
    }
    return interface.find_patches(masks[part]).areas


@quantity("–", name="{}_patches", each=_NUMBERS)
def patches(solved: SolvedScene, part: str) -> float:
    """number of connected patches of {}."""
    return float(_patches(solved, part).size)


@quantity("–", name="{}_patches_largest", each=_LARGEST)
def largest_patch(solved: SolvedScene, part: str) -> float:
    """share of the nominal area in the largest patch of {}."""
    return float(_patches(solved, part).max(initial=0.0))


def _closeness(solved: SolvedScene) -> Any:
    """Return a dimensionless field on the grid that is larger where the bodies are
    closer.

    It is the pressure over the largest one where it is between 0 and the hardness; at
    other points the gap over the range of the heights is taken from it.  At the
    hardness all pressures are equal, and the points that have flowed furthest are
    closest.
    """
    pressure = solved.pressure
    gap = solved.field("gap")
    height = np.ptp(solved.scene.surface.heights) or solved.height_scale
    by_gap = pressure <= 0
    if not solved.flows:
        at_the_cap = solved.at_the_cap
        if "plastic_displacement" in solved.result.fields:
            lowered = solved.field("plastic_displacement")
            gap = np.add(gap, lowered, out=gap.copy(), where=~at_the_cap)
        by_gap |= at_the_cap
    closeness = pressure / (pressure.max() or 1.0)
    return np.subtract(closeness, gap / height, out=closeness, where=by_gap)


def _percolations(solved: SolvedScene) -> list[interface.Limit]:
    """Return the fractions at which the contact and the gap percolate.

    Both are computed at the same time, if the measurement may use two threads.
    """
    closeness = _closeness(solved)
    with Workers(min(solved.threads, 2)) as workers:
        return workers.each(interface.percolation_fraction, [closeness, -closeness])


@_limit("–")
def contact_percolation(solved: SolvedScene) -> interface.Limit:
    """share of the nominal area, the closest points first, that first connects across a
    period.
    """
    return solved.once(_percolations)[0]


@_limit("–")
def gap_percolation(solved: SolvedScene) -> interface.Limit:
    """share of the nominal area, the widest gaps first, that first connects across a
    period.
    """
    return solved.once(_percolations)[1]
