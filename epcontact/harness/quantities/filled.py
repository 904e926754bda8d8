"""Fractions of the contact and of the load on heights that nobody measured.

A measured map has holes, and spikes of the instrument that a user removes.  Both are
filled with heights that follow from those around them.  Summits reflect light away from
the instrument, so that holes are often where contact is: the filled points may carry
most of the load.  These quantities and a note report how much they carry.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from epcontact.errors import InvalidCase
from epcontact.harness.quantities.registry import quantity
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.results import LoadStep

#: The names of the quantities of this module.
FILLED = ("quantity.filled_contact", "quantity.filled_load")
#: Fraction of the load on filled heights above which a note says so: more than on
#: measured ones.
MOST = 0.5


@quantity("–")
def filled_contact(solved: SolvedScene) -> float:
    """fraction of the grid points in contact whose heights were filled or replaced, not
    measured.

    It is 0 for a surface without such heights.
    """
    return _fraction_on_filled(solved, solved.pressure > 0)


@quantity("–")
def filled_load(solved: SolvedScene) -> float:
    """fraction of the load on grid points whose heights were filled or replaced, not
    measured.

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


def filled_notes(steps: Sequence[LoadStep]) -> tuple[str, ...]:
    """Return a note if more than half of the load is on filled heights at some load.

    Args:
        steps: the load steps of a path, one at least.

    Returns:
        One sentence for users, with the fraction and the mean pressure; () if no note
        is needed.
    """
    fractions = [step.quantities.get("filled_load", 0.0) for step in steps]
    largest = max(fractions)
    if not largest > MOST:
        return ()
    pressure = steps[fractions.index(largest)].mean_pressure
    return (
        f"{100 * largest:.3g} % of the load at {pressure:.4g} Pa is on heights that "
        "were filled or replaced and not measured, so that the contact is that of the "
        "filling: measure the points without a height again (other exposure, objective "
        "or tilt, or a stylus), or crop the map to a part with fewer of them",
    )
