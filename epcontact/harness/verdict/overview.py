"""What a person reads first of a verdict: is it right, how right, and where to look.

The terminal and the first screen of the report show the same content in the same order:
the verdict in a sentence, how well the methods agree with each other and with exact
solutions (J2 elements with boundary elements before all others), the gates nearest to
falling short, what is not covered, and the cases by what they verify.

On the page, a table counts the gates; it is called the matrix.  The matrix has a row
for each subject (what a gate verifies) and a column for each kind of reference.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from epcontact.harness.gates import ERROR, FALLS_SHORT, GateVerdict
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.evidence import (
    EXPERIMENTS,
    J2_PAIR,
    KINDS,
    SUBJECTS,
)
from epcontact.harness.verdict.judgement import (
    SKIPPED,
    CaseVerdict,
    Verdict,
    tightest,
)

_GateOfCase = tuple[CaseVerdict, GateVerdict]
#: A margin above this is that of a difference by rounding alone.
_MARGIN_OF_ROUNDING = 1000
#: Empty fraction of a bar at each of its ends, see `band_bar`.
_BAR_MARGIN = 0.04
#: Gates that a first screen lists as nearest to falling short.
TIGHTEST_COUNT = 5
#: Quantities with a row of their own in the table of agreement; the others share one.
_COMPARED = (
    "total area",
    "elastic area",
    "plastic area",
    "mean gap",
    "elastic energy",
    "pressure distribution",
    "pressure field",
    "largest pressure",
)
_OTHER_QUANTITIES = "other quantities"
#: Groups of quantities that describe the work of a solver.  No gate is expected to read
#: them, so that they do not count as uncovered.
_OF_WORK = ("cost.", "iterations.", "residual.")
#: What references of these kinds are called, beside the method that is judged.
_FORMULAS = {"closed form": "closed forms", "published": "published laws"}
_ONE_LAW = "finite elements – boundary elements"
#: Parts of the names of pairs of methods, in the order of the table of agreement.
_ORDER = (f"{J2_PAIR}, effective", J2_PAIR, _ONE_LAW, "plain", "theory")
#: What gates compare, by a part of the name of their pair or by the kind of their
#: reference.
_EVIDENCE = {
    J2_PAIR: "J2 elements with boundary elements",
    _ONE_LAW: "elements with boundary elements of one law",
    "plain": "fast elements with plain scikit-fem",
    "closed form": "results with closed forms",
    "published": "results with published ones",
    "theory": "numerical methods with the theory",
    "other code": "results with programs of others",
    "experiment": "results with experiments",
    "method here": "results with other or earlier ones of this program",
}
#: Marks gates that expect a difference, such as that of an approximation.
_KNOWN_DIFFERENCE = "known difference"


@dataclass(frozen=True)
class Agreement:
    """How well two methods, or a method and its closed forms, agree on a quantity.

    Attributes:
        pair: what is compared, such as "theory – boundary elements"; or "known
            differences" for gates that expect a difference, J2 elements apart.
        quantity: the quantity in words, such as "total area"; what is compared, if it
            is a known difference.
        gates: the number of comparisons.
        median: the median of the absolute relative differences, or of the distances.
        largest: the largest of them.
        case: the id of the case with the largest difference.
    """

    pair: str
    quantity: str
    gates: int
    median: float
    largest: float
    case: str


@dataclass(frozen=True)
class AreaPoint:
    """A contact area against its reference, both as fractions of the nominal area.

    Attributes:
        case: the id of the case.
        part: "total", "elastic" or "plastic".
        pair: what is compared, as in `Agreement`, or "known difference".
        reference: the area of the reference.
        value: the area of the method that is judged.
        error: half the width of the interval of their difference.
        low, high: the ends of the band of the gate, around the reference.
    """

    case: str
    part: str
    pair: str
    reference: float
    value: float
    error: float
    low: float
    high: float


def overview(verdict: Verdict) -> dict[str, Any]:
    """Return the data of the report's first screen.

    Args:
        verdict: the verdict on all cases.

    Returns:
        A dictionary with these keys:

        - `headline`, `evidence`, `uncovered_sentence`: see the functions of this module
          with these names;
        - `tightest`: for each gate nearest to falling short its `case` (the id), `gate`
          (its verdict), `words` (see `gate_words`), `margin` (a text) and `bar` (see
          `band_bar`);
        - `agreement`, `points`: lists of `Agreement` and `AreaPoint`;
        - `kinds`: the meaning of each kind of reference by its name, the columns;
        - `matrix`: for each subject, the row of cells, see `_cell`; one cell per kind;
        - `subjects`: for each subject, a list with one dictionary per case that mainly
          verifies it, the tightest first: its id, status, requirement and counts of
          gates, see `_gate_counts`;
        - `uncovered`: the quantities that no gate reads;
        - `experiments`: the measurements that no case uses, by kind; empty if a gate
          compares with an experiment.
    """
    gates = _gates_of(verdict)
    subjects = _with_others(SUBJECTS, (gate.subject for _, gate in gates))
    kinds = _with_others(KINDS, (gate.kind for _, gate in gates))
    rows: dict[str, list[dict[str, Any]]] = {}
    for subject, cases in cases_by_subject(verdict).items():
        rows[subject] = []
        for case in cases:
            row = _gate_counts((case, gate) for gate in case.gates)
            row |= {"id": case.id, "status": case.status}
            row["requirement"] = case.skipped_because or case.requirement
            rows[subject].append(row)
    tight = []
    for case, gate in tightest_gates(verdict):
        words = gate_words(gate)
        tight.append(
            {
                "case": case.id,
                "gate": gate,
                "words": words,
                "margin": margin_text(gate),
                "bar": band_bar(gate),
            }
        )
    return {
        "headline": headline(verdict),
        "evidence": evidence(verdict),
        "tightest": tight,
        "agreement": agreement(verdict),
        "points": area_points(verdict),
        "kinds": {kind: KINDS.get(kind, "") for kind in kinds},
        "matrix": {subject: _matrix_row(gates, subject, kinds) for subject in subjects},
        "subjects": rows,
        "uncovered_sentence": uncovered_sentence(verdict),
        "uncovered": [QUANTITIES[name] for name in _uncovered(verdict)],
        "experiments": {} if _rests_on_experiment(verdict) else EXPERIMENTS,
    }


def _gates_of(verdict: Verdict) -> list[_GateOfCase]:
    """Return all gates of a verdict, each with its case."""
    return [(case, gate) for case in verdict.cases for gate in case.gates]


# --- is it right?


def headline(verdict: Verdict) -> str:
    """Return the verdict in one sentence, without a final point.

    It counts comparisons apart from identities, such as "317 of 317 comparisons and 453
    of 453 identities hold in 78 cases; 11 cases are skipped".
    """
    parts = []
    for words, are_identities in (("comparisons", False), ("identities", True)):
        held = [
            gate.holds
            for _, gate in _gates_of(verdict)
            if (gate.kind == "identity") == are_identities
        ]
        if held:
            parts.append(f"{sum(held)} of {len(held)} {words}")
    counts = Counter[str](case.status for case in verdict.cases)
    judged = len(verdict.cases) - counts[SKIPPED]
    sentence = f"{' and '.join(parts) or 'no gates'} hold in {_count(judged, 'case')}"
    if counts[SKIPPED] == len(verdict.cases) > 0:
        sentence = "nothing was judged"
    if counts[FALLS_SHORT]:
        verb = "falls" if counts[FALLS_SHORT] == 1 else "fall"
        sentence += f"; {_count(counts[FALLS_SHORT], 'case')} {verb} short"
    if counts[ERROR]:
        verb = "has an error" if counts[ERROR] == 1 else "have errors"
        sentence += f"; {_count(counts[ERROR], 'case')} {verb}"
    if counts[SKIPPED]:
        verb = "is" if counts[SKIPPED] == 1 else "are"
        sentence += f"; {_count(counts[SKIPPED], 'case')} {verb} skipped"
    return sentence


def _count(number: int, noun: str) -> str:
    """Return a number with its noun, such as "1 gate" or "3 gates"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def evidence(verdict: Verdict) -> str:
    """Return a sentence that counts the gates by what they compare, without a final
    point.

    Comparisons of elements with boundary elements are first, and laws that any correct
    result obeys are last.  The sentence is empty without a gate.
    """
    counts = Counter(_evidence_of(gate) for _, gate in _gates_of(verdict))
    parts = [
        f"{what} ({counts[key]})" for key, what in _EVIDENCE.items() if counts[key]
    ]
    if counts["identity"]:
        parts.append(f"and {counts['identity']} identities that any result must obey")
    return f"compared: {', '.join(parts)}" if parts else ""


def _evidence_of(gate: GateVerdict) -> str:
    """Return what a gate compares: a key of `_EVIDENCE`, or "identity"."""
    pair = _pair_of(gate) if gate.kind == "method here" else ""
    return next((part for part in _EVIDENCE if part in pair), gate.kind)


# --- where to look


def tightest_gates(verdict: Verdict, count: int = TIGHTEST_COUNT) -> list[_GateOfCase]:
    """Return the gates with the least margins, the least first, each with its case.

    Of each case file there is one gate, because the cases of a file resemble each
    other.  If this gives fewer gates than `count`, further gates follow that compare
    with a reference or do not hold.  A gate that could not be judged comes before all
    others.

    Args:
        verdict: the verdict on all cases.
        count: the largest number of gates.
    """
    ordered = _by_margin(_gates_of(verdict))
    of_family: dict[str, _GateOfCase] = {}
    others = []
    for case, gate in ordered:
        family = case.family or case.id
        if family not in of_family:
            of_family[family] = (case, gate)
        elif gate.kind != "identity" or not gate.holds:
            others.append((case, gate))
    first = list(of_family.values())[:count]
    return _by_margin([*first, *others[: count - len(first)]])


def _by_margin(gates: Iterable[_GateOfCase]) -> list[_GateOfCase]:
    """Return gates, each with its case, sorted by their margins, the least first.

    A gate that could not be judged comes before all others.
    """

    def margin(pair: _GateOfCase) -> float:
        """Return the margin of a gate; -1 if it could not be judged."""
        value = pair[1].margin
        return -1.0 if math.isnan(value) else value

    return sorted(gates, key=margin)


def band_bar(gate: GateVerdict) -> dict[str, float]:
    """Return where the band and the interval of a gate are on a bar of length 1.

    Args:
        gate: the verdict on the gate.

    Returns:
        Positions between 0 and 1: `low` and `high` of the band, `left` and `right` of
        the interval of the difference, and its mean, `middle`.  The dictionary is empty
        if the gate could not be judged or a value is not finite.
    """
    if gate.difference is None:
        return {}
    mean, half = gate.difference.mean, gate.half_width
    values = {
        "low": gate.low,
        "high": gate.high,
        "left": mean - half,
        "right": mean + half,
        "middle": mean,
    }
    start, end = min(values.values()), max(values.values())
    if not math.isfinite(end - start) or start == end:
        return {}
    margin = _BAR_MARGIN
    scale = (1 - 2 * margin) / (end - start)
    return {name: margin + (x - start) * scale for name, x in values.items()}


def quantity_words(name: str) -> str:
    """Return the name of a quantity in words, such as "total area".

    Args:
        name: the name of the quantity in gates, such as "area.total.corrected".
    """
    group, _, rest = name.partition(".")
    words = rest.replace("_", " ").replace(".", ", ")
    if group == "area":
        part, _, kind = rest.partition(".")
        return f"{part} area" if kind == "corrected" else f"{part} area ({kind})"
    if group == "field":
        return f"{words} field"
    if group == "distribution":
        return "pressure distribution"
    if group in ("residual", "iterations", "cost"):
        return f"{group}: {words}"
    return words or name.replace("_", " ")


def gate_words(gate: GateVerdict) -> str:
    """Return what a gate compares in words, such as "total area of boundary elements
    against theory".

    A gate that expects a difference is marked as such.
    """
    words = (
        f"{quantity_words(gate.quantity)} of {_method_words(gate.of)} against "
        f"{_reference_words(gate)}"
    )
    if expects_difference(gate):
        words += f" ({_KNOWN_DIFFERENCE})"
    return words


def expects_difference(gate: GateVerdict) -> bool:
    """Return whether a gate holds only if both sides differ: 0 is outside its band.

    Such a gate states the known error of an approximation.  Only relative differences
    count, because a distance of two fields is never 0.
    """
    return gate.norm == "relative" and not gate.low <= 0 <= gate.high


def _method_words(name: str) -> str:
    """Return a method in words; the name of a solver that is not registered itself."""
    return METHODS[name].full_name if name in METHODS else name


def _reference_words(gate: GateVerdict) -> str:
    """Return the reference of a gate in words: a method, a closed form or a number."""
    if not isinstance(gate.against, str):
        return f"{gate.against:.4g}"
    if gate.against in METHODS:
        return _method_words(gate.against)
    return gate.against.replace("_", " ")


# --- how right is it?


def _pair_of(gate: GateVerdict) -> str:
    """Return what two sides a gate compares, such as "theory – boundary elements".

    For J2 flow beside a pressure cap it is the subject of the gate, which names the
    hardness.  It is "" for a number, which has no other side.
    """
    if not isinstance(gate.against, str):
        return ""
    if gate.subject.startswith(J2_PAIR):
        return gate.subject
    first = _method_words(gate.of)
    if gate.kind in _FORMULAS:
        return f"{first} – {_FORMULAS[gate.kind]}"
    sides = [first, _method_words(gate.against)]
    sides.sort(key=lambda side: (side != "theory", "finite" not in side, side))
    pair = " – ".join(sides)
    top = ", rough top" if "rough top" in gate.subject else ""
    return f"{pair}, one law{top}" if _ONE_LAW in pair else pair


def agreement(verdict: Verdict) -> list[Agreement]:
    """Return how well methods agree with each other and with closed forms.

    The gates are those with a method or a formula as reference, except for those of the
    norm "absolute".  They are grouped by the two sides and by the quantity; quantities
    that are not in `_COMPARED` are one group, "other quantities".  A gate without a
    finite difference is left out.  The first groups are those of J2 elements with
    boundary elements.  Other gates that expect a difference are the last groups: their
    pair is "known differences", and the two sides are in the place of the quantity.
    """
    groups: dict[tuple[str, str], list[tuple[float, str]]] = defaultdict(list)
    for case, gate in _gates_of(verdict):
        pair = _pair_of(gate)
        if gate.norm == "absolute" or gate.difference is None or not pair:
            continue
        if not math.isfinite(gate.difference.mean):
            continue
        words = quantity_words(gate.quantity)
        quantity = words if words in _COMPARED else _OTHER_QUANTITIES
        if expects_difference(gate) and J2_PAIR not in pair:
            quantity = pair
            pair = f"{_KNOWN_DIFFERENCE}s"
        groups[pair, quantity].append((abs(gate.difference.mean), case.id))
    order = {name: place for place, name in enumerate(_COMPARED)}
    rows = []
    for (pair, quantity), differences in groups.items():
        largest, case_id = max(differences)
        middle = median(difference for difference, _ in differences)
        rows.append(
            Agreement(pair, quantity, len(differences), middle, largest, case_id)
        )
    return sorted(
        rows,
        key=lambda row: (
            _pair_order(row.pair),
            order.get(row.quantity, len(order)),
        ),
    )


def area_points(verdict: Verdict) -> list[AreaPoint]:
    """Return the contact areas of a verdict with their references, for a picture.

    They are those of gates whose reference is a method or a formula; an area of 0 has
    no place on the logarithmic axes and is left out.
    """
    points = []
    for case, gate in _gates_of(verdict):
        pair = _pair_of(gate)
        if not gate.quantity.startswith("area.") or not pair:
            continue
        if gate.value is None or gate.reference is None:
            continue
        value, reference = gate.value.mean, gate.reference.mean
        if not (0 < value <= 1 and 0 < reference <= 1):
            continue
        if expects_difference(gate) and J2_PAIR not in pair:
            pair = _KNOWN_DIFFERENCE  # has one colour
        scale = reference if gate.norm == "relative" else 1.0
        points.append(
            AreaPoint(
                case=case.id,
                part=gate.quantity.split(".")[1],
                pair=pair,
                reference=reference,
                value=value,
                error=gate.half_width * scale,
                low=reference + gate.low * scale,
                high=reference + gate.high * scale,
            )
        )
    return sorted(points, key=lambda point: _pair_order(point.pair))


def _pair_order(pair: str) -> tuple[bool, bool, int, str]:
    """Return a key that sorts comparisons of two methods before those with formulas.

    Two methods are in the order of `_ORDER`, and known differences are last.  `pair` is
    a text of `_pair_of`.
    """
    with_formula = pair.endswith(tuple(_FORMULAS.values()))
    places = (place for place, part in enumerate(_ORDER) if part in pair)
    place = next(places, len(_ORDER))
    return pair.startswith(_KNOWN_DIFFERENCE), with_formula, place, pair


# --- what is not covered, and the cases


def uncovered_sentence(verdict: Verdict) -> str:
    """Return one sentence on what a verdict does not cover, without a final point."""
    parts = []
    if not _rests_on_experiment(verdict):
        parts.append("no gate rests on an experiment")
    skipped = [case.id for case in verdict.cases if case.status == SKIPPED]
    if skipped:
        verb = "was" if len(skipped) == 1 else "were"
        parts.append(f"{_count(len(skipped), 'case')} {verb} skipped")
    left_out = sum(len(case.not_judged) for case in verdict.cases)
    if left_out:
        verb = "is" if left_out == 1 else "are"
        parts.append(
            f"{_count(left_out, 'gate')} {verb} judged at another size than "
            f"{verdict.size}"
        )
    unread = len(_uncovered(verdict))
    if unread:
        verb = "has" if unread == 1 else "have"
        parts.append(f"{unread} quantities {verb} no gate")
    return "; ".join(parts)


def skipped_cases(verdict: Verdict) -> dict[str, list[str]]:
    """Return the ids of the skipped cases of a verdict by the reason for skipping."""
    names: dict[str, list[str]] = defaultdict(list)
    for case in verdict.cases:
        if case.status == SKIPPED:
            reason = case.skipped_because.removeprefix("skipped: ")
            names[reason].append(case.id)
    return dict(names)


def _rests_on_experiment(verdict: Verdict) -> bool:
    """Return whether a gate of the verdict compares with an experiment."""
    return any(gate.kind == "experiment" for _, gate in _gates_of(verdict))


def _uncovered(verdict: Verdict) -> list[str]:
    """Return the names of the quantities that no gate of the verdict reads.

    Error estimates and the work of solvers are left out: no gate is expected to read
    them.
    """
    judged = {gate.quantity for _, gate in _gates_of(verdict)}
    names: list[str] = []
    for name in QUANTITIES:
        is_error = name.endswith("error") or "_error_by_" in name
        if name not in judged and not is_error and not name.startswith(_OF_WORK):
            names.append(name)
    return names


def least_margin(case: CaseVerdict) -> float:
    """Return the least margin of the gates of a case, by which cases are sorted.

    It is -1 if a gate could not be judged, and infinite without a gate.
    """
    gate = tightest(case.gates)
    if gate is None:
        return math.inf
    return -1.0 if math.isnan(gate.margin) else gate.margin


def cases_by_subject(verdict: Verdict) -> dict[str, list[CaseVerdict]]:
    """Return the cases of a verdict by what they verify, each case once.

    A case belongs to the subject of most of its gates that compare, or of most gates if
    all check identities.  A case without a gate belongs to the last group, "not
    judged".  The cases of a group are sorted by their tightest gates.
    """
    groups: dict[str, list[CaseVerdict]] = defaultdict(list)
    for case in sorted(verdict.cases, key=least_margin):
        groups[_main_subject(case)].append(case)
    used = [subject for subject in groups if subject != _NOT_JUDGED]
    order = [subject for subject in _with_others(SUBJECTS, used) if subject in groups]
    if _NOT_JUDGED in groups:
        order.append(_NOT_JUDGED)
    return {subject: groups[subject] for subject in order}


_NOT_JUDGED = "not judged"


def _main_subject(case: CaseVerdict) -> str:
    """Return what most gates of a case verify; "not judged" without a gate."""
    compared = [gate.subject for gate in case.gates if gate.kind != "identity"]
    subjects: Sequence[str] = compared or [gate.subject for gate in case.gates]
    if not subjects:
        return _NOT_JUDGED
    return Counter(subjects).most_common(1)[0][0]


def _with_others(names: Iterable[str], used: Iterable[str]) -> list[str]:
    """Return names in their order, followed by the used ones that are not among them,
    sorted.
    """
    listed = list(names)
    return [*listed, *sorted({*used} - {*listed})]


def _matrix_row(
    gates: Iterable[_GateOfCase], subject: str, kinds: Iterable[str]
) -> list[dict[str, Any]]:
    """Return a row of the matrix: the cell of each kind of reference for one subject.

    Args:
        gates: all gates of the verdict, each with its case.
        subject: what the gates of the row verify.
        kinds: the kinds of reference, the columns in their order.
    """
    of_kind: dict[str, list[_GateOfCase]] = {kind: [] for kind in kinds}
    for case, gate in gates:
        if gate.subject == subject:
            of_kind[gate.kind].append((case, gate))
    return [_cell(gates_of_kind) for gates_of_kind in of_kind.values()]


def _gate_counts(gates: Iterable[_GateOfCase]) -> dict[str, Any]:
    """Return how many gates there are and hold, and the tightest one.

    Args:
        gates: gates of a verdict, each with its case.

    Returns:
        `gates` and `held`, two numbers of gates, and, unless there is no gate,
        `nearest`, the name of the gate with the least margin, and `margin`, its text.
    """
    verdicts = [gate for _, gate in gates]
    counts: dict[str, Any] = {
        "gates": len(verdicts),
        "held": sum(gate.holds for gate in verdicts),
    }
    nearest = tightest(verdicts)
    if nearest is not None:
        counts["margin"] = margin_text(nearest)
        counts["nearest"] = nearest.name
    return counts


def _cell(gates: list[_GateOfCase]) -> dict[str, Any]:
    """Return one cell of the matrix; empty if it has no gates.

    Args:
        gates: the gates of one subject and one kind of reference, with their cases.

    Returns:
        The counts of `_gate_counts`; `status`, the worst status of the gates; and
        `cases`, the counts of each case by its id.
    """
    if not gates:
        return {}
    statuses = {gate.status for _, gate in gates}
    worst = next((s for s in (ERROR, FALLS_SHORT) if s in statuses), "holds")
    by_case: dict[str, list[_GateOfCase]] = {}
    for case, gate in gates:
        by_case.setdefault(case.id, []).append((case, gate))
    cases = {name: _gate_counts(of_case) for name, of_case in by_case.items()}
    return _gate_counts(gates) | {"status": worst, "cases": cases}


def margin_text(gate: GateVerdict) -> str:
    """Return the margin of a judged gate as text, in three digits.

    The margin is the width of the band over the difference; see `GateVerdict.margin`.
    The text is "exact" for a margin above 1000, because only rounding separates such
    values, and "–" for a gate that could not be judged.
    """
    if math.isnan(gate.margin):
        return "–"
    return "exact" if gate.margin > _MARGIN_OF_ROUNDING else f"{gate.margin:.3g}"
