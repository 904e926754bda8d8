"""What a gate verifies, and what its reference is: the rows and the columns of the
report's matrix.

Both follow from the quantity, the two sides of the gate and the load path.  Only a gate
against a number may state the kind of its reference itself, by the key `kind`.  Without
this key, the number 0 counts as an identity, and any other number counts as a value of
this program.
"""

from __future__ import annotations

from itertools import pairwise

from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import Gate
from epcontact.harness.methods.registry import METHODS
from epcontact.reference import CLOSED_FORMS

#: The kinds of reference.  All but an identity are comparisons with something else.
KINDS = {
    "method here": "another method or a finer result of this program, or a limit",
    "closed form": "a formula, evaluated here",
    "published": "a value or a law that others published",
    "other code": "the result of a program that others wrote",
    "experiment": "a measurement",
    "identity": "a law that holds for any result, such as the balance of force",
}

#: The comparison for which the project exists: elements with J2 flow beside boundary
#: elements with a pressure cap.  Its subjects begin so, and the hardness follows.
J2_PAIR = "J2 elements – boundary elements"
_EFFECTIVE = "effective hardness"
_MODEL, _AFTER, _INPUTS = "J2 flow – pressure cap", "after the load", "inputs"
#: What can be verified: the J2 model or the theory against another model, the package's
#: own methods, the state after the load has fallen, and the inputs.
SUBJECTS = (
    f"{J2_PAIR}, {_EFFECTIVE}",
    f"{J2_PAIR}, 3 σ_Y",
    _MODEL,
    *(method.title for method in reversed(METHODS.values()) if method.title),
    "theory – boundary elements",
    _AFTER,
    _INPUTS,
)
#: Kinds of published measurements that no case uses, and the data that they lack.
EXPERIMENTS = {
    "real contact area": (
        "areas at several loads, with the measured map and hardness of the body"
    ),
    "topography after the load": (
        "maps of one place before and after, with load and hardness"
    ),
    "contact conductance": (
        "the spectrum: reports give rms height and slope, not their bandwidth"
    ),
}
#: Beginnings of the names of quantities that compare J2 flow with a pressure cap.
_MODEL_MEASURES = ("quantity.model_", "quantity.effective_")
#: Beginnings of the names of quantities that compare elements with another solve.
_SECOND_SOLVES = ("quantity.elements_", "quantity.moved_")


def kind_of(case: Case, gate: Gate) -> str:
    """Return the kind of a gate's reference: one of the keys of `KINDS`.

    Args:
        case: the case of the gate, which says what names are methods.
        gate: the gate, whose `against` is a method, a closed form or a number.
    """
    if gate.against in case.methods:
        # A user's solver is itself under test: its reference is this program.
        judges_other_code = _is_other_code(gate.of) and not _is_of_user(gate.of)
        if judges_other_code or _is_other_code(str(gate.against)):
            return "other code"
        return "method here"
    if isinstance(gate.against, str):
        return "closed form" if CLOSED_FORMS[gate.against].exact else "published"
    if gate.kind:
        return gate.kind
    compares = gate.quantity.startswith((*_MODEL_MEASURES, *_SECOND_SOLVES))
    return "identity" if gate.against == 0 and not compares else "method here"


def subject_of(case: Case, gate: Gate) -> str:
    """Return what a gate verifies, in words for a table.

    This is one of `SUBJECTS`; or the name of another method; or two methods with a dash
    between them, such as "theory – tamaas", if they model the body differently.  Of J2
    flow beside a pressure cap, the hardness follows, such as "2.7 σ_Y".  "rough top"
    follows if the nodes of the elements' top are moved to the heights.

    Args:
        case: the case of the gate, with its methods, options and load path.
        gate: the gate.
    """
    if gate.quantity.startswith(("quantity.surface_", "field.heights")):
        return _INPUTS
    sides = [gate.of]
    if gate.against in case.methods:
        sides.append(str(gate.against))
    options = case.options.get(gate.of, {})
    top = ", rough top" if options.get("geometry") == "moved" else ""
    names = {_body_model(case, name): _full_name(name) for name in sides}
    if names.keys() == {"j2", "cap"}:
        flowing = "J2 elements" if "finite" in names["j2"] else names["j2"]
        return f"{flowing} – {names['cap']}, {_hardness_words(case)}{top}"
    if any(later < earlier for earlier, later in pairwise(case.load.path)):
        return _AFTER
    if gate.quantity.startswith(_MODEL_MEASURES):
        return _MODEL
    if len(names) == 1:
        sides = [gate.of]
    sides.sort(key=lambda name: name != "persson")
    return " – ".join(_full_name(name) for name in sides) + top


def _hardness_words(case: Case) -> str:
    """Return the pressure cap of a case in words: "effective hardness" if it was looked
    up for the J2 body, or a number of yield stresses, such as "3 σ_Y".
    """
    if case.told_hardness:
        return _EFFECTIVE
    return f"{case.material.hardness / case.material.yield_stress:.3g} σ_Y"


def _full_name(name: str) -> str:
    """Return a method's name in words, such as "boundary elements" for "bem"; the name
    itself if the method is not registered.
    """
    return METHODS[name].full_name if name in METHODS else name


def _is_other_code(name: str) -> bool:
    """Return whether a method, given by its name, is code from outside this package.

    A name that is not registered is that of a solver given by `--solver`.
    """
    return name not in METHODS or METHODS[name].foreign


def _is_of_user(name: str) -> bool:
    """Return whether a method, given by its name, is a solver that the user added: by
    `--solver` or as an entry point.
    """
    return name not in METHODS or bool(METHODS[name].source)


def _body_model(case: Case, name: str) -> str:
    """Return how a method models the body of a case: "theory", "j2" or "cap".

    Args:
        case: the case, with the options of its methods.
        name: the name of the method.

    "cap" is an elastic body with a largest pressure.  A body that is elastic in all
    methods counts as "cap" too, so that elastic methods do not differ.
    """
    if name == "persson":
        return "theory"
    can_flow = name in METHODS and METHODS[name].has_model_measures
    flows = can_flow and case.options.get(name, {}).get("law", "j2") == "j2"
    return "j2" if flows else "cap"
