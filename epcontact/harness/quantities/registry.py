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

from epcontact.errors import InvalidCase
from epcontact.harness.gates import l2_distance
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.reference import CLOSED_FORMS
from epcontact.results import ContactResult
from epcontact.scene import Scene


@dataclass(frozen=True)
class Quantity:
    """A scalar that a gate can read.

    `unit` is "–" if it has none.  What the quantity `needs` is checked before anything
    is solved: "fields" and "J2 flow" of the method, and a finite "hardness" of the
    scene.  `measure` is None if methods report the quantity.
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
    """Return the first paragraph of a docstring in one line."""
    return " ".join((function.__doc__ or "").partition("\n\n")[0].split())


def _measure_word(
    measure: Callable[[SolvedScene, str], float], word: str, solved: SolvedScene
) -> float:
    return measure(solved, word)


def error_name_of(name: str) -> str:
    """Return the name of the error that a quantity claims (area.total.error), or ""."""
    error = f"{name.removesuffix('.corrected')}.error"
    return error if error in QUANTITIES else ""


# --- reading
# -------------------------------------------------------------------------------------


def scalar_quantities(result: ContactResult) -> dict[str, float]:
    """Return every scalar of the last load step by its name in gates."""
    final = result.final
    known = {"mean_pressure": final.mean_pressure}
    for kind, areas in final.areas.items():
        known |= {f"area.{part}.{kind}": area for part, area in vars(areas).items()}
    reported = (final.quantities, final.residuals, final.iterations, result.cost)
    for group, values in zip(REPORTED_GROUPS, reported, strict=True):
        known |= {group + key: float(value) for key, value in values.items()}
    return known


def read_quantity(result: ContactResult, name: str) -> float:
    """Return the scalar called `name` at the last load step of a result, or raise
    InvalidCase.
    """
    known = scalar_quantities(result)
    if name not in known:
        has = ", ".join(sorted(known))
        raise InvalidCase(f"{result.method} has no quantity {name!r}; it has {has}")
    return known[name]


def measure_on(solved: SolvedScene, name: str) -> float:
    """Measure a quantity, or "l2.<closed form>.<field>": a field's distance from its
    closed form.

    Raises InvalidCase if the result lacks what the quantity needs.
    """
    if name.startswith("l2."):
        _, form, field = name.split(".", 2)
        exact = CLOSED_FORMS[form].field(field, solved.scene)
        return l2_distance(solved.field(field), exact)
    found = QUANTITIES[name]
    assert found.measure is not None, f"{name} is reported by the methods, not measured"
    if "fields" in found.needs:
        solved.field("pressure")  # raises InvalidCase if it is missing
    try:
        return found.measure(solved)
    except InvalidCase as error:  # a gate beside it must not be blamed
        raise InvalidCase(f"{name}: {error}") from error


def measure_all(
    names: Collection[str], scene: Scene, result: ContactResult
) -> dict[str, float]:
    """Measure quantities of a result with its fields; common solves run once."""
    solved = SolvedScene(scene, result)
    return {name: measure_on(solved, name) for name in names}


def measure(name: str, scene: Scene, result: ContactResult) -> float:
    """Measure a quantity of a result with its fields; see `measure_on`."""
    return measure_on(SolvedScene(scene, result), name)
