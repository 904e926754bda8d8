"""What a gate verifies, and what its reference is: the rows and the columns of the
report's matrix.

Both follow from the quantity, the two sides and the load path.  Only a number says
itself what it is, by `kind`, as it may be anything; without that it counts as a figure
of this program, or as an exact identity if it is 0.
"""

from __future__ import annotations

from itertools import pairwise

from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import Gate
from epcontact.harness.methods.registry import METHODS
from epcontact.reference import CLOSED_FORMS

#: The kinds of reference, the last three of which are the work of others.
KINDS = {
    "identity": "what must be so whatever the answer is, such as the balance of force",
    "closed form": "a formula, evaluated here",
    "method here": (
        "another method, or another or a finer answer of this program, or a limit"
    ),
    "other code": "an answer of a program that others wrote",
    "published": "a figure or a law that others published",
    "experiment": "a measurement",
}
OF_OTHERS = ("other code", "published", "experiment")

_MODEL, _AFTER, _INPUTS = "J2 flow – pressure cap", "after the load", "inputs"
_NAMES = {"persson": "theory", "bem": "boundary elements", "fem": "finite elements"}
#: What can be verified: inputs, methods, differences of models, and what follows a
#: falling load.
SUBJECTS = (_INPUTS, *_NAMES.values(), "theory – boundary elements", _MODEL, _AFTER)
#: Published measurements that no case holds, and what they lack.
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
_MODEL_MEASURES = ("quantity.model_", "quantity.effective_")


def kind_of(case: Case, gate: Gate) -> str:
    """Return the kind of a gate's reference, of `KINDS`; a user's solver is judged."""
    if gate.against in case.methods:
        peer = (
            gate.of in METHODS
            and METHODS[gate.of].foreign
            and not METHODS[gate.of].source
        )
        return "other code" if peer or _foreign(str(gate.against)) else "method here"
    if isinstance(gate.against, str):
        return "closed form" if CLOSED_FORMS[gate.against].exact else "published"
    compares = gate.quantity.startswith((*_MODEL_MEASURES, "quantity.elements_"))
    return gate.kind or (
        "identity" if gate.against == 0 and not compares else "method here"
    )


def subject_of(case: Case, gate: Gate) -> str:
    """Return what a gate verifies: one of `SUBJECTS`, or another method or
    difference.
    """
    if (
        gate.quantity.startswith("quantity.surface_")
        or gate.quantity == "field.heights"
    ):
        return _INPUTS
    if any(later < earlier for earlier, later in pairwise(case.load.path)):
        return _AFTER
    sides = [gate.of, str(gate.against)] if gate.against in case.methods else [gate.of]
    laws = {_law(case, name) for name in sides}
    if laws == {"j2", "cap"} or gate.quantity.startswith(_MODEL_MEASURES):
        return _MODEL
    if len(laws) == 1:
        sides = [gate.of]
    sides.sort(key=lambda name: name != "persson")
    return " – ".join(_NAMES.get(name, name) for name in sides)


def _foreign(name: str) -> bool:
    return name not in METHODS or METHODS[name].foreign


def _law(case: Case, name: str) -> str:
    """Return what a method takes the body for; what is elastic in all methods is no
    difference.
    """
    if name == "persson":
        return "theory"
    flows = name in METHODS and METHODS[name].has_model_measures
    return (
        "j2" if flows and case.options.get(name, {}).get("law", "j2") == "j2" else "cap"
    )
