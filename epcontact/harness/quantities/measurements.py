"""Quantities that are measured of the surface, the fields and the interface with numpy alone."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness import interface
from epcontact.harness.gates.distances import carried_pressure
from epcontact.harness.quantities.answered import Answered, largest
from epcontact.harness.quantities.registry import quantity
from epcontact.reference import roughness
from epcontact.results import APART, ELASTIC, PLASTIC

# --- the surface: another seed, or the surface turned round, would change these ------------------


@quantity("surface_rms_height", "m", needs=())
def rms_height(a: Answered) -> float:
    """rms height of the surface."""
    return a.scene.surface.rms_height


@quantity("surface_rms_slope", "–", needs=())
def rms_slope(a: Answered) -> float:
    """rms slope of the surface by spectral derivatives."""
    return roughness.rms_slope(a.scene)


@quantity("surface_highest", "m", needs=())
def highest(a: Answered) -> float:
    """height of the highest point over the mean."""
    heights = a.scene.surface.heights
    return float((heights - heights.mean()).max())


@quantity("surface_skewness", "–", needs=())
def skewness(a: Answered) -> float:
    """skewness of the heights: of the other sign upside down."""
    above = a.scene.surface.heights - a.scene.surface.heights.mean()
    return float((above**3).mean() / (above**2).mean() ** 1.5)


def _summit(a: Answered) -> tuple[int, ...]:
    heights = a.scene.surface.heights
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(heights)), heights.shape))


def _summit_along(a: Answered, axis: int) -> float:
    return float(_summit(a)[axis] / a.scene.surface.shape[axis])


for _axis, _letter in enumerate("xy"):
    quantity(
        f"surface_summit_{_letter}",
        "–",
        needs=(),
        meaning=f"place of the highest point along {_letter}, over the period",
    )(partial(_summit_along, axis=_axis))


@quantity("surface_curvature", "1/m", needs=())
def summit_curvature(a: Answered) -> float:
    """curvature at the highest point by differences, mean over the axes."""
    surface, summit, curvatures = a.scene.surface, _summit(a), []
    for axis, d in enumerate(surface.spacing):
        beside = [np.roll(surface.heights, shift, axis)[summit] for shift in (1, -1)]
        curvatures.append((2 * surface.heights[summit] - sum(beside)) / d**2)
    return float(np.mean(curvatures))


# --- the fields and the distribution -------------------------------------------------------------


@quantity("measured_force", "–")
def force(a: Answered) -> float:
    """mean(p)/p0 - 1.

    After a path to zero load it is mean(p) over the largest mean pressure.
    """
    return (float(a.pressure.mean()) - a.scene.load.final) / a.load_scale


@quantity("measured_bounds", "–")
def bounds(a: Answered) -> float:
    """largest distance of p from [0, hardness], over p0."""
    p = a.pressure
    beyond = max(-float(p.min()), float(p.max()) - a.scene.material.hardness, 0.0)
    return beyond / a.load_scale


@quantity("measured_gap", "–")
def gap(a: Answered) -> float:
    """largest violation of the contact conditions (Karush-Kuhn-Tucker) over the rms height:
    |g| where 0 < p < hardness, -g where p = 0, g where p = hardness.

    After a path that unloads, the surface is the one that the reported plastic displacement has
    left, on which every contact is elastic.
    """
    gap, touching = a.open_gap

    def wrong(p: Any, g: Any, flowing: Any, touching: Any) -> Any:
        return np.where(p <= 0, -g, np.where(flowing & ~touching, g, np.abs(g)))

    return largest(wrong, a.pressure, gap, a.at_the_cap, touching) / a.scene.surface.rms_height


@quantity("measured_raw_total", "–")
def raw_total(a: Answered) -> float:
    """share of grid points with p > 0, less the raw area."""
    return float((a.pressure > 0).mean()) - a.result.final.areas["raw"].total


@quantity("measured_raw_plastic", "–")
def raw_plastic(a: Answered) -> float:
    """share of grid points at the hardness, less the raw plastic area."""
    return float(a.at_the_cap.mean()) - a.result.final.areas["raw"].plastic


@quantity("measured_carried", "–")
def carried(a: Answered) -> float:
    """(int sigma dF + hardness A_pl)/p0 - 1 of the reported distribution."""
    found, hardness = a.result.distribution, a.scene.material.hardness
    if found is None:
        raise InvalidCase(f"{a.result.method} gives no pressure distribution for a gate")
    carried = carried_pressure(found)
    if math.isfinite(hardness):
        carried += hardness * found.plastic
    return (carried - a.scene.load.final) / a.load_scale


@quantity("smallest_contact_pressure", "Pa")
def smallest_contact_pressure(a: Answered) -> float:
    """smallest pressure where p > 0."""
    p = a.pressure
    return float(p[p > 0].min()) if (p > 0).any() else 0.0


# --- the interface under load --------------------------------------------------------------------


def stiffness(a: Answered, branch: interface.Branch) -> float:
    """Return the stiffness of the interface on a branch of the load, in Pa/m."""
    return interface.interface_stiffness(a.scene, a.result, branch)


def conductance(a: Answered, branch: interface.Branch) -> float:
    """Return the contact conductance per area times the sum of the resistivities, in 1/m."""
    return interface.contact_conductance(a.scene, stiffness(a, branch), resistivity=1.0)


_BRANCHES: tuple[tuple[interface.Branch, str], ...] = (
    ("loading", "if the load grows next"),
    ("unloading", "if the load falls next"),
)
for _branch, _next in _BRANCHES:
    quantity(
        f"stiffness_{_branch}",
        "Pa/m",
        meaning=f"d(mean pressure)/d(approach of the mean planes), {_next}",
    )(partial(stiffness, branch=_branch))
for _branch, _next in _BRANCHES:
    quantity(
        f"conductance_{_branch}",
        "1/m",
        meaning="contact conductance per nominal area times the sum of the bodies' resistivities, "
        + _next,
    )(partial(conductance, branch=_branch))


def _patches(a: Answered, part: str) -> Any:
    state = a.field("state")
    mask = state != APART if part == "total" else state == {"elastic": ELASTIC}.get(part, PLASTIC)
    return interface.patches(mask).areas


def _number_of_patches(a: Answered, part: str) -> float:
    return float(_patches(a, part).size)


def _largest_patch(a: Answered, part: str) -> float:
    return float(_patches(a, part).max(initial=0.0))


for _part in ("total", "elastic", "plastic"):
    quantity(f"{_part}_patches", "–", meaning=f"number of connected patches of {_part} contact")(
        partial(_number_of_patches, part=_part)
    )
    quantity(
        f"{_part}_patches_largest",
        "–",
        meaning=f"share of the nominal area in the largest patch of {_part} contact",
    )(partial(_largest_patch, part=_part))


@quantity("contact_percolation", "–")
def contact_percolation(a: Answered) -> float:
    """share of the nominal area, the closest points first, that first connects across a period."""
    return interface.percolation_share(_closeness(a))


@quantity("gap_percolation", "–")
def gap_percolation(a: Answered) -> float:
    """share of the nominal area, the widest gaps first, that first connects across a period."""
    return interface.percolation_share(-_closeness(a))


def _closeness(a: Answered) -> Any:
    p, gap, height = a.pressure, a.field("gap"), np.ptp(a.scene.surface.heights)
    if "plastic_displacement" in a.result.fields and not a.flows:
        gap = gap + np.where(a.at_the_cap, 0.0, a.field("plastic_displacement"))
    # At the hardness all pressures are equal, and the points that have flowed furthest are closest.
    loose = (p <= 0) | (a.at_the_cap & (not a.flows))
    return p / (p.max() or 1.0) - np.where(loose, gap / height, 0.0)
