"""The registry of quantities: every scalar that a gate can read, with its unit and
meaning.

Methods *report* the quantities of `reported.csv`.  The harness itself *measures* the
others in the process that solved the scene, so that no solver checks itself.  To add
one, write a function of a solved scene; its name is that of the quantity, its
docstring the meaning:

    @quantity("–")
    def measured_force(solved: SolvedScene) -> float:
        \"\"\"mean(p)/p0 - 1.\"\"\"
        return float(solved.pressure.mean()) / solved.scene.load.final - 1
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.resources import files

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.gates import l2_distance
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.reference import CLOSED_FORMS
from epcontact.results import ContactResult
from epcontact.scene import Scene


@dataclass(frozen=True)
class Quantity:
    """A scalar that a gate can read.

    Attributes:
        name: its name in gates, such as "area.total.raw".
        unit: "–" if it has none.
        meaning: a phrase without a final point.
        needs: what must exist before anything is solved: "fields" or "J2 flow" of the
            method, or a finite "hardness" of the scene.
        measure: returns its value on a solved scene; None: methods report it.
    """

    name: str
    unit: str
    meaning: str
    needs: tuple[str, ...] = ()
    measure: Callable[[SolvedScene], float] | None = None


#: A method from outside the package may report unlisted quantities of these groups.
REPORTED_GROUPS = ("quantity.", "residual.", "iterations.", "cost.")

#: Every quantity by its name, such as `QUANTITIES["area.total.raw"]`; the measured ones
#: are here once the package `quantities` is imported.
QUANTITIES: dict[str, Quantity] = {}
with (
    files("epcontact.harness.quantities")
    .joinpath("reported.csv")
    .open(encoding="utf-8") as _rows
):
    for _name, _unit, _meaning in list(csv.reader(_rows))[1:]:
        _needs = ("fields",) if _name.startswith("field.") else ()
        QUANTITIES[_name] = Quantity(_name, _unit, _meaning, _needs)


def quantity(
    unit: str,
    needs: tuple[str, ...] = ("fields",),
    name: str = "",
    each: Mapping[str, str] = {},
) -> Callable[[Callable[..., float]], Callable[..., float]]:
    """Return the decorator that adds a function to `QUANTITIES`.

    The first paragraph of the function's docstring is the meaning of the quantity.

    Args:
        unit: of its values; "–" if there is none.
        needs: what must be there, see `Quantity`.
        name: of the quantity after "quantity."; empty: that of the function.
        each: words with texts.  There is one quantity for each word, which is the
            second argument of the function; {} in `name` becomes the word, and {} in
            the meaning its text.
    """

    def add(measure: Callable[..., float]) -> Callable[..., float]:
        """Add a function to `QUANTITIES`, and return the function itself."""
        meaning = _first_paragraph(measure).removesuffix(".")
        template = f"quantity.{name or measure.__name__}"
        if not each:
            QUANTITIES[template] = Quantity(template, unit, meaning, needs, measure)
        for word, text in each.items():
            full = template.format(word)
            of_word = partial(_measure_word, measure, word)
            QUANTITIES[full] = Quantity(
                full, unit, meaning.format(text), needs, of_word
            )
        return measure

    return add


def _first_paragraph(function: Callable[..., float]) -> str:
    """Return the first paragraph of a function's docstring in one line; "" without."""
    return " ".join((function.__doc__ or "").partition("\n\n")[0].split())


def _measure_word(
    measure: Callable[[SolvedScene, str], float], word: str, solved: SolvedScene
) -> float:
    """Return measure(solved, word), the value of a quantity that exists for each of
    several words.
    """
    return measure(solved, word)


def error_name_of(name: str) -> str:
    """Return the name of the quantity that is the error estimate of another one.

    This is "area.total.error" for "area.total.corrected".  It is "" if there is none.
    """
    error = f"{name.removesuffix('.corrected')}.error"
    return error if error in QUANTITIES else ""


# --- reading


def scalar_quantities(result: ContactResult) -> dict[str, float]:
    """Return every scalar of a result's last load step by its name in gates, such as
    "area.total.raw", in SI units.
    """
    final = result.final
    scalars = {"mean_pressure": final.mean_pressure}
    for kind, areas in final.areas.items():
        for part, area in vars(areas).items():
            scalars[f"area.{part}.{kind}"] = area
    reported = (final.quantities, final.residuals, final.iterations, result.cost)
    for group, values in zip(REPORTED_GROUPS, reported, strict=True):
        for name, value in values.items():
            scalars[group + name] = float(value)
    return scalars


def read_quantity(result: ContactResult, name: str) -> float:
    """Return a scalar at the last load step of a result, in its SI unit.

    `name` is its name in gates.  Raises InvalidCase if the result does not have it.
    """
    scalars = scalar_quantities(result)
    if name not in scalars:
        has = ", ".join(sorted(scalars))
        raise InvalidCase(f"{result.method} has no quantity {name!r}; it has {has}")
    return scalars[name]


def measure_on(solved: SolvedScene, name: str) -> float:
    """Return the value of a quantity, measured on a solved scene, in its unit.

    Args:
        solved: the scene and its result, with the fields of its last load.
        name: a key of `QUANTITIES` that is measured; or "l2.FORM.FIELD" for the
            relative L2 distance of a field from that of the closed form FORM.

    Raises:
        InvalidCase: if there is no such quantity, if the methods report it themselves,
            if the result lacks what it needs, or if it is not defined for the result.
    """
    if name.startswith("l2."):
        _, form, field = name.split(".", 2)
        exact = CLOSED_FORMS[form].field(field, solved.scene)
        return l2_distance(solved.field(field), exact)
    if name not in QUANTITIES:
        raise InvalidCase(f"no quantity is called {name!r}{nearest(name, QUANTITIES)}")
    quantity_of_name = QUANTITIES[name]
    measure_it = quantity_of_name.measure
    if measure_it is None:
        raise InvalidCase(f"{name} is reported by the methods, and not measured")
    if "fields" in quantity_of_name.needs:
        solved.field("pressure")  # raises InvalidCase if it is missing
    try:
        return measure_it(solved)
    except InvalidCase as error:  # a gate beside it must not be blamed
        raise InvalidCase(f"{name}: {error}") from error


def measure_all(
    names: Collection[str], scene: Scene, result: ContactResult
) -> dict[str, float]:
    """Return the values of several quantities of a result by their names.

    A linear solve that several quantities need is done once.

    Args:
        names: see `measure_on`.
        scene: the scene, whose path ends at the load of the fields.
        result: the result of the scene, with its fields.

    Raises:
        InvalidCase: see `measure_on`.
    """
    solved = SolvedScene(scene, result)
    return {name: measure_on(solved, name) for name in names}


def measure(name: str, scene: Scene, result: ContactResult) -> float:
    """Return the value of one quantity of a scene's result, which has its fields.

    `name` and the errors are those of `measure_on`.
    """
    return measure_on(SolvedScene(scene, result), name)
