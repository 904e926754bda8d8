"""The error of areas on a grid that does not resolve the waves of a surface.

The areas are corrected for where their fronts lie between the grid points.  This
assumes that the heights between the points are those of a smooth surface.  A crease, as
between the bowls of a peened surface or the arcs of a milled one, lies between points,
and has waves of any length.  A spectrum that reaches up to the shortest wave of the
grid shows this.  How much is missing is then seen on a grid of every second point:
errors by creases are proportional to the spacing, so that they are as large as the
difference of the results of both grids.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from epcontact.errors import SurfaceWarning
from epcontact.results import Areas, LoadStep
from epcontact.scene import Surface

#: Waves count as the shortest of the grid from this fraction of its largest wave number
#: on.
_SHORTEST = 0.9
#: Fractions of the squared slope in the shortest waves: below the first one a grid
#: resolves its surface, and from the second one on the difference of the two grids
#: counts completely.  Maps with 3 points a wave or more have 0, or 3e-5 if they are
#: mirrored (96 points a side); surfaces with creases have 0.0013 to 0.03
#: (`laboratory.sharp_kinds`).
_RESOLVED = 1e-4
_UNRESOLVED = 2e-3
#: Most lines along each axis that are transformed.
_LINES = 256
#: Fewest points along an axis of which every second one is taken.
_FEWEST = 8


def unresolved_weight(surface: Surface) -> float:
    """Return how much of the change on a grid of every second point counts as error.

    The weight is 0 for a surface that a formula gives, or whose spectrum ends before
    the shortest wave of the grid; 1 if more than 0.2 % of the squared slope are in
    waves of about two spacings; and between 0 and 1 otherwise.
    """
    if not surface.sampled:
        return 0.0
    fraction = _fraction_in_shortest_waves(surface)
    weight = (fraction - _RESOLVED) / (_UNRESOLVED - _RESOLVED)
    return min(max(weight, 0.0), 1.0)


def _fraction_in_shortest_waves(surface: Surface) -> float:
    """Return the fraction of the mean squared slope in the shortest waves of the grid.

    The slopes along each axis are those of evenly chosen lines, `_LINES` at most.  A
    flat surface has 0.
    """
    shortest = 0.0
    total = 0.0
    for axis, spacing in enumerate(surface.spacing):
        size = surface.shape[axis]
        if size < _FEWEST:
            continue
        lines = np.moveaxis(surface.heights, axis, -1).reshape(-1, size)
        lines = lines[:: -(-len(lines) // _LINES)]
        wave_number = np.fft.rfftfreq(size) * 2  # over the largest one
        modes = np.abs(np.fft.rfft(lines - lines.mean()) * wave_number / spacing)
        power = np.square(modes).mean(axis=0) / size**2
        total += float(power.sum())
        shortest += float(power[wave_number > _SHORTEST].sum())
    return shortest / total if total > 0 else 0.0


def every_second_point(surface: Surface) -> tuple[Surface, Any]:
    """Return a surface with every second point of another, and the index of the points.

    An axis of fewer than 8 points keeps all of them.  If the number of points is odd,
    the period becomes longer by a spacing.  The surface has no notes, no errors by its
    treatment and no alternatives.
    """
    steps = [2 if size >= _FEWEST else 1 for size in surface.shape]
    points = tuple(slice(None, None, step) for step in steps)
    heights = np.ascontiguousarray(surface.heights[points])
    heights.flags.writeable = False
    periods = [
        step * spacing * size
        for step, spacing, size in zip(
            steps, surface.spacing, heights.shape, strict=True
        )
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)  # said of the surface itself
        coarse = Surface(
            heights,
            tuple(periods),
            recipe=f"every second point of {surface.fingerprint}",
        )
    return coarse, points


def with_resolution_error(
    step: LoadStep, coarse: LoadStep, weight: float, hardness: float
) -> LoadStep:
    """Return a load step whose errors by the grid hold for creases, too.

    Args:
        step: the step on the grid, with areas "corrected" and "error".
        coarse: the step at the same load at every second point.
        weight: the fraction of the differences that is added, in squares.
        hardness: in Pa, may be infinite; the contact is at least the load over it, and
            its plastic part at most, so that no error need reach beyond these bounds.
    """
    error = step.areas["error"]
    corrected = step.areas["corrected"]
    coarse_areas = coarse.areas["corrected"]
    carried = step.mean_pressure / hardness
    bounds = {"total": (carried, 1.0), "elastic": (0.0, 1.0), "plastic": (0.0, carried)}
    errors = {}
    for part, area in vars(corrected).items():
        change = weight * (area - getattr(coarse_areas, part))
        least, most = bounds[part]
        farthest = max(area - least, most - area, getattr(error, part))
        errors[part] = min(math.hypot(getattr(error, part), change), farthest)
    quantities = dict(step.quantities)
    change = weight * (quantities["mean_gap"] - coarse.quantities["mean_gap"])
    name = "mean_gap_error_by_grid"
    quantities[name] = math.hypot(quantities[name], change)
    areas = {**step.areas, "error": Areas(**errors)}
    return replace(step, areas=areas, quantities=quantities)
