"""Faults of the harness: measurements, statistics, gates, verdict, kept results."""

import math
from dataclasses import replace

import faults
import numpy as np
from junitparser import Skipped

from breaking.fault import (
    REFUSED,
    Fault,
    at,
    both,
    changed,
    given,
    on_result,
    scaled,
    solver,
)
from epcontact.harness.quantities.registry import QUANTITIES

H = "epcontact.harness."
GATE, QUANTITY = H + "gates.", H + "quantities.registry."
RUN, VERDICT = H + "answers.run.", H + "verdict."


def _blind(name):
    """A measured quantity that is always zero."""

    def patch(monkeypatch):
        monkeypatch.setitem(
            QUANTITIES, name, replace(QUANTITIES[name], measure=lambda a: 0.0)
        )

    return patch


def _fault(what, patch, *seen, **more):
    return Fault(what, "harness", patch, *seen, **more)


def _without_width(estimate):
    return estimate.model_copy(update={"half_width": 0.0})


def _largest(original):
    return lambda values: original(values).model_copy(
        update={"mean": float(max(values))}
    )


def _reversed(case, answers):
    """The results of the boundary elements in another order than their labels and
    partners.
    """
    return case, answers | {
        "bem": replace(answers["bem"], results=answers["bem"].results[::-1])
    }


def _shifted(answer):
    ensemble = answer["ensemble"]
    return answer | {"ensemble": ensemble | {"surfaces": ensemble["surfaces"][::-1]}}


def _exchanged(answer):
    areas = answer["areas"]
    return answer | {
        "areas": areas | {"raw": areas["corrected"], "corrected": areas["raw"]}
    }


def _best(answer):
    members = answer["members"]
    best = {k: min(m["residuals"][k] for m in members) for k in answer["residuals"]}
    return answer | {"residuals": best}


def _with_exit_code(original):
    return lambda *a: original(*a).model_copy(update={"exit_code": 2})


def _elastic(case, recipe):
    return case.changed(material=replace(case.material, hardness=math.inf)), recipe


PAIRED = ("fem-ensemble", "quantity.mean_gap")
DISTANCE, DEVIATION = VERDICT + "judgement.distance", GATE + "deviation"
L2 = QUANTITY + "l2_distance"
TESTS = "tests/test_verdict.py::"
SUMMED = "test_the_answer_of_a_method_sums_up_its_members"
MEASURES = "tests/test_identities.py::test_wrong_answers_get_their_known_scores"

FAULTS = (
    # comparison
    *(
        _fault(what, patch, "yardstick", "distribution")
        for what, patch in {
            "no distance between distributions": at(DISTANCE, lambda *_: 0.0),
            "distance not divided by its scale": scaled(DISTANCE, 1e9),
            "the reference's distribution compared with itself": given(
                DISTANCE, lambda norm, a, b, hardness: (norm, b, b, hardness)
            ),
            "the supremum for the Wasserstein distance": given(
                DISTANCE, lambda norm, *rest: ("supremum", *rest)
            ),
            "carried pressure without the factor 1/2": scaled(
                H + "gates.carried_pressure", 2.0
            ),
        }.items()
    ),
    *(
        _fault(what, patch, "yardstick", "area.total.raw", against, status=REFUSED)
        for what, against, patch in (
            ("absolute for relative", 0.5, at(DEVIATION, lambda norm, a, b: a - b)),
            (
                "relative to the value, not to the reference",
                0.5,
                changed(DEVIATION, lambda f: lambda norm, a, b: -f(norm, b, a)),
            ),
            ("sign of a difference lost", 1.5, on_result(DEVIATION, abs)),
            ("half a difference", 1.5, scaled(DEVIATION, 0.5)),
        )
    ),
    *(
        _fault(what, patch, "yardstick", "field.pressure")
        for what, patch in {
            "distance of a field not measured": at(L2, lambda *_: 0.0),
            "the maximum norm for L2": at(
                L2, lambda a, b: float(np.abs(a - b).max() / np.abs(b).max())
            ),
            "L2 relative to the answer, not to the closed form": given(
                L2, lambda a, b: (b, a)
            ),
        }.items()
    ),
    _fault(
        "a repeated member of an ensemble",
        at(H + "answers.store.Answer.twins", property(lambda self: None)),
        test=TESTS + "test_status_of_a_case",
    ),
    _fault(
        "the first load step judged, not the last",
        at(
            "epcontact.results.ContactResult.final",
            property(lambda self: self.steps[0]),
        ),
        "fem-uniaxial",
        "quantity.approach",
        status=REFUSED,
    ),
    _fault(
        "the closed form of another surface",
        given(
            H + "case_files.case.Case.scene",
            lambda case, recipe: (
                case,
                replace(recipe, amplitude=1.01 * recipe.amplitude),
            ),
        ),
        "westergaard-line",
        "quantity.surface_rms_height",
    ),
    _fault(
        "the hardness of a case lost",
        given(H + "case_files.case.Case.scene", _elastic),
        "punch-capped",
        "area.plastic.corrected",
        status="error",
    ),
    # statistics and bookkeeping: two surfaces and a paired gate
    *(
        Fault(what, "harness", patch, *PAIRED, surfaces=2, status=REFUSED)
        for what, patch in {
            "intervals without width": on_result(GATE + "estimate", _without_width),
            "the largest for the mean": changed(GATE + "estimate", _largest),
            "an interval of 68 %": at(H + "gates.CONFIDENCE", 0.68),
            "the interval of a single value for that of the mean": changed(
                H + "gates.student_half_width", lambda f: lambda s, n: f(s, n) * n**0.5
            ),
            "n for n - 1 in the standard deviation": scaled(
                H + "gates.standard_deviation", 0.5**0.5
            ),
            "pairs taken as independent": given(
                VERDICT + "judgement.judge",
                lambda gate, a, b, paired, claim: (gate, a, b, False, claim),
            ),
            "the answers in the reverse order": given(
                VERDICT + "verification.judge_case", _reversed
            ),
        }.items()
    ),
    *(
        _fault(what, on_result(RUN + "summary", wrong), test=TESTS + SUMMED)
        for what, wrong in {
            "labels of the surfaces shifted": _shifted,
            "raw and corrected areas exchanged in the answer": _exchanged,
            "the best residual of an ensemble": _best,
            "one member of an ensemble left out": lambda answer: (
                answer | {"members": answer["members"][1:]}
            ),
        }.items()
    ),
    # measurements
    *(
        _fault(f"{name} always zero", _blind(f"quantity.{name}"), test=MEASURES)
        for name in (
            "measured_force",
            "measured_bounds",
            "measured_gap",
            "measured_carried",
        )
    ),
    # gates and verdict
    _fault(
        "the default gates dropped",
        at(H + "case_files.model.default_gates", lambda: ()),
        test="tests/test_casefile.py::test_a_case_has_the_default_gates_of_its_methods",
    ),
    _fault(
        "a shortfall passes",
        both(at(VERDICT + "judgement.FALLS_SHORT", "fell short"), solver(faults.stiff)),
        "westergaard-line",
        "quantity.mean_gap",
        status=REFUSED,
    ),
    *(
        _fault(
            f"every {what} holds",
            both(
                on_result(
                    VERDICT + judged, lambda v: v.model_copy(update={"status": "holds"})
                ),
                solver(faults.stiff),
            ),
            "westergaard-line",
            "quantity.mean_gap",
            status=REFUSED,
        )
        for what, judged in (
            ("case", "verification.judge_case"),
            ("gate", "judgement.judge"),
        )
    ),
    _fault(
        "an answer of this program taken for one of another code",
        at(VERDICT + "evidence._foreign", lambda name: True),
        test=TESTS + "test_what_a_gate_verifies_and_on_what_it_rests",
    ),
    _fault(
        "no failure in junit.xml",
        at(VERDICT + "verification.Failure", Skipped),
        test=TESTS + "test_files_say_what_the_verdict_says",
    ),
    _fault(
        "the exit code of an error for a shortfall",
        both(
            changed(VERDICT + "judgement.Verdict.on", _with_exit_code),
            solver(faults.stiff),
        ),
        "westergaard-line",
        "quantity.mean_gap",
        status=REFUSED,
    ),
)
