"""How quantities are read of an answer: those that its method reports, and those measured of it.

`registry` says which quantities there are.
"""

from __future__ import annotations

from collections.abc import Collection

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.gates.distances import l2_distance
from epcontact.harness.quantities.measurements import Answered
from epcontact.harness.quantities.registry import QUANTITIES, REPORTED_GROUPS
from epcontact.reference import CLOSED_FORMS
from epcontact.results import ContactResult
from epcontact.scene import Scene


def read_quantity(result: ContactResult, name: str) -> float:
    """Return the scalar called `name` at the last load step of a result.

    Raises:
        InvalidCase: if the result has no such scalar.
    """
    known = scalar_quantities(result)
    if name not in known:
        raise InvalidCase(
            f"{result.method} has no quantity {name!r}; it has {', '.join(sorted(known))}"
        )
    return known[name]


def scalar_quantities(result: ContactResult) -> dict[str, float]:
    """Return every scalar of the last load step by its name in gates."""
    final = result.final
    known = {"mean_pressure": final.mean_pressure}
    for kind, areas in final.areas.items():
        for part in ("total", "elastic", "plastic"):
            known[f"area.{part}.{kind}"] = getattr(areas, part)
    reported = (final.quantities, final.residuals, final.iterations, result.cost)
    for group, values in zip(REPORTED_GROUPS, reported, strict=True):
        known |= {group + key: float(value) for key, value in values.items()}
    return known


def measure(name: str, scene: Scene, result: ContactResult) -> float:
    """Measure the quantity called `name`; see `measure_all`."""
    return measure_all([name], scene, result)[name]


def measure_all(names: Collection[str], scene: Scene, result: ContactResult) -> dict[str, float]:
    """Measure quantities of a result with its fields; common solves run once.

    Args:
        names: names of measured quantities, or "l2.<closed form>.<field>" for the distance of a
            field from its closed form.
        scene: the scene that was solved.
        result: the answer to it, with fields.

    Raises:
        InvalidCase: if the result lacks what a quantity needs.
    """
    answered = Answered(scene, result)
    return {name: measured(name, answered) for name in names}


def measured(name: str, answered: Answered) -> float:
    """Measure the quantity called `name` of a result that others may have been measured of.

    Raises InvalidCase; see `measure_all`.
    """
    group, _, rest = name.partition(".")
    if group == "l2":
        form, _, field = rest.partition(".")
        exact = CLOSED_FORMS[form].field(field, answered.scene)
        return l2_distance(answered.field(field), exact)
    if name not in QUANTITIES:
        raise InvalidCase(f"no quantity is called {name!r}{nearest(name, QUANTITIES)}")
    quantity = QUANTITIES[name]
    if quantity.measure is None:
        raise InvalidCase(f"{name} is reported by the methods, not measured")
    if "fields" in quantity.needs:
        answered.field("pressure")  # raises InvalidCase if it is missing
    try:
        return quantity.measure(answered)
    except InvalidCase as error:  # a gate beside it must not be blamed
        raise InvalidCase(f"{name}: {error}") from error
