"""Fractions of the contact and of the load on heights that nobody measured.

A measured map has holes, and spikes of the instrument that a user removes.  Both are
filled with heights that follow from those around them.  Summits reflect light away from
the instrument, so that holes are often where contact is: the filled points may carry
most of the load.  These quantities report how much they carry, and a note of
`epcontact.alternatives` where it is most of it.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from epcontact.errors import InvalidCase
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene

#: The names of the quantities of this module.
FILLED = ("quantity.filled_contact", "quantity.filled_load")


@quantity("–")
def filled_contact(solved: SolvedScene) -> float:
    """fraction of the grid points in contact whose heights were filled, clipped or
    replaced, not measured.

    It is 0 for a surface without such heights.
    """
    return _fraction_on_filled(solved, solved.pressure > 0)


@quantity("–")
def filled_load(solved: SolvedScene) -> float:
    """fraction of the load on grid points whose heights were filled, clipped or
    replaced, not measured.

    It is 0 for a surface without such heights.
    """
    return _fraction_on_filled(solved, solved.pressure)


def _fraction_on_filled(solved: SolvedScene, values: NDArray[Any]) -> float:
    """Return the sum of values at the filled points over that at all points.

    It is 0.0 for a surface without filled points.  `values` is an array on the grid.

    Raises InvalidCase if the sum over all points is 0, because nothing is in contact.
    """
    if solved.scene.surface.filled is None:
        return 0.0
    total = float(values.sum())
    if total == 0:
        raise InvalidCase("nothing is in contact, so that no point carries load")
    return float(values[solved.scene.surface.filled].sum()) / total
