"""Faults of what a person reads: the page, the tables of a terminal, pictures, field files."""

from dataclasses import replace

import numpy as np

from breaking.fault import Fault, changed, edited, given, scaled
from epcontact.results import COLUMNS, ELASTIC, PLASTIC

SHOWN = "tests/test_shown.py::test_"
CHARTS = "tests/test_output_charts.py::test_"
PAGE = SHOWN + "the_page_shows_the_verdict_and_the_answers"
MATRIX = SHOWN + "the_page_opens_with_a_matrix_and_ends_it_with_what_is_not_covered"
GATES = SHOWN + "the_table_of_gates_shows_the_verdict"
FILE = SHOWN + "a_field_file_is_that_of_the_last_load"
CURVE = CHARTS + "a_distribution_has_means_of_surfaces_and_the_theory_is_its_formula"
LEGEND = CHARTS + "the_legend_has_the_colours_of_the_map"
LOADS = "tests/test_loads.py::test_"
HARDNESS = LOADS + "every_load_has_its_own_hardness_and_what_its_interval_is_worth"
C = "epcontact.output.charts."


def _shown(what, patch, test):
    return Fault(what, "output", patch, test=test)


def _template(old, new):
    """The template of the report with one text in the place of another."""

    def change(original):
        def wrong(environment, name):
            text = environment.loader.get_source(environment, name)[0]
            assert old in text, f"the template does not hold {old}"
            return environment.from_string(text.replace(old, new))

        return wrong

    return changed("jinja2.Environment.get_template", change)


def _turned(states):
    return np.select([states == ELASTIC, states == PLASTIC], [PLASTIC, ELASTIC], states)


def _drawn(change):
    """A field that is changed before it is drawn."""
    wrong = lambda axes, field, *rest: (axes, change(field), *rest)  # noqa: E731
    return given(C + "maps.show_field", wrong)


FAULTS = (
    _shown("a cell of the matrix with the margin of another one",
        _template("cell.margin }}</a>", "(cells|select|first).margin }}</a>"), MATRIX),
    _shown("a quantity that no gate judges left out",
        _template("one in overview.uncovered", "one in overview.uncovered[1:]"), MATRIX),
    _shown("value and reference exchanged on the page",
        _template('(("value", 4), ("reference", 4)', '(("reference", 4), ("value", 4)'), PAGE),
    _shown("the difference shown as the value", _template("gate[key].mean", "gate.value.mean"),
        PAGE),
    _shown("the widest margin for the tightest",
        edited("epcontact.harness.verdict.judgement.tightest", "min(gates", "max(gates"),
        SHOWN + "the_table_of_cases_shows_the_gate_nearest_to_the_end_of_its_band"),
    _shown("a list in which a bare verify leaves nothing out",
        changed("epcontact.cli.listing._verified", lambda _: lambda *_: True),
        "tests/test_cli.py::"
        "test_the_list_has_each_family_once_and_says_what_a_bare_verify_leaves_out[200]"),
    _shown("a heading that always holds", _template("if verdict.passed", "if true"), PAGE),
    _shown("a badge that always holds", _template("badge(gate.status)", 'badge("holds")'), PAGE),
    _shown("the ends of a band exchanged on the page",
        _template("[{{ gate.low|number }}, {{ gate.high", "[{{ gate.high|number }}, {{ gate.low"),
        PAGE),
    _shown("the first gate in every row",
        _template("gate in case.gates", "gate in case.gates[:1] * case.gates|length"), PAGE),
    _shown(
        "raw areas shown as corrected on a terminal",
        given(
            "epcontact.cli.tables.answers_table",
            lambda found, *rest: ({
                name: replace(a, results=tuple(
                    replace(r,
                        steps=(replace(r.final,
                            areas=dict(r.final.areas) | {"corrected": r.final.areas["raw"]}),))
                    for r in a.results)) for name, a in found.items()
            }, *rest),
        ),
        SHOWN + "the_table_of_loads_shows_the_answers",
    ),
    _shown("colours of elastic and plastic contact exchanged against the legend", _drawn(_turned),
        LEGEND),
    _shown("a map upside down", _drawn(lambda field: field[:, ::-1]),
        LEGEND),
    _shown("the elastic curve at twice the diffusion",
        given("epcontact.persson.pressure_density", lambda sigma, G, p0: (sigma, 2 * G, p0)),
        CURVE),
    _shown(
        "the curve with hardness at the elastic density",
        changed("epcontact.persson.pressure_curve", lambda f: lambda G, p0,
            hardness: replace(f(G, p0, hardness), density=f(G, p0).density)),
        CURVE,
    ),
    _shown("densities in the wrong unit", scaled("epcontact.persson.pressure_density", 1e9), CURVE),
    _shown("pressures of a curve in MPa",
        changed(C + "curves.unit_for", lambda f: lambda largest, unit: (1e6, "MPa")), CURVE),
    _shown("a row of figures beside another load",
        changed("epcontact.harness.answers.store.load_rows",
            lambda f: lambda *given: (rows := f(*given))[1:] + rows[:1]),
        LOADS + "every_load_has_its_own_figures_and_fields"),
    _shown("an area that leaves out what the interval of its hardness is worth",
        changed("epcontact.harness.answers.loads._with_hardness_error",
            lambda f: lambda step, *_: step),
        HARDNESS),
    _shown("the hardness of the last load at every load",
        changed("epcontact.harness.answers.loads._walked",
            lambda f: lambda task, scene, own, *rest, **k:
                f(task, scene, [own[-1]] * len(own), *rest, **k)),
        HARDNESS),
    _shown("a gap in Pa", lambda patch: patch.setitem(COLUMNS, "mean_gap", "Pa"),
        LOADS + "units_are_those_of_the_quantities_and_suit_the_figures"),
)  # fmt: skip
