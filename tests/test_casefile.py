"""Case files: what is read is what was written, and all mistakes are told, each in a sentence."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from command_line import invoke
from conftest import SMALL_CASE
from fem_scenes import J2_CASE, MODEL_GATE

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import find_case, find_cases, find_named, load_case
from epcontact.harness.case_files.citations import PAPERS, citation, papers_of, sources_of
from epcontact.harness.case_files.tables import default_gates
from epcontact.harness.case_files.text import SIZES, at_size
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.verification import verify


def test_sizes_replace_every_table_of_sizes() -> None:
    data = {"a": {"fast": 1, "full": 2}, "b": [{"c": {"fast": 3, "full": 4}}], "d": {"e": 5}}
    assert at_size(data, "full") == {"a": 2, "b": [{"c": 4}], "d": {"e": 5}}


def test_case_becomes_scenes(write_case) -> None:
    case = load_case(write_case(), "full")
    assert [recipe.seed for recipe in case.recipes] == [3, 5, 7]
    assert (case.recipes[0].shape, case.material.hardness) == ((64, 64), 6.0e9)
    assert case.options == {
        "persson": {"energy_reduction": 0.536, "reduction": "constant", "spectrum": "analytic"},
        "bem": {"tolerance": 1e-8},
    }
    # The digest is known before the surface is made.
    assert all(case.digest(recipe) == case.scene(recipe).digest for recipe in case.recipes)
    assert len({case.digest(recipe) for recipe in case.recipes}) == 3
    assert load_case(write_case(("hardness = 6.0e9", ""))).material.hardness == math.inf


def test_a_copy_of_a_case_differs_where_it_is_told(write_case) -> None:
    case = load_case(write_case())
    other = case.changed(methods=("bem",), id="other", requirement="Another.")
    assert (other.methods, other.id, other.requirement) == (("bem",), "other", "Another.")
    assert (other.gates, other.recipes, other.path) == (case.gates, case.recipes, case.path)
    assert (case.methods, case.id) == (("persson", "bem"), "small")
    with pytest.raises(AttributeError):
        case.changed(method="bem")


def test_every_shipped_case_reads_at_every_size_and_cites_papers() -> None:
    cases = [load_case(text, size) for text in find_cases() for size in text.sizes]
    assert all(case.gates or case.sweep for case in cases)
    assert all(len(gate.because) > 10 for case in cases for gate in case.gates)
    assert all(papers_of(case) for case in cases)
    assert {paper for case in cases for paper in papers_of(case)} == set(PAPERS)


def test_byte_order_mark_and_line_ends_of_windows(write_case) -> None:
    path = write_case()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load_case(path).id == "small"


# --- mistakes ------------------------------------------------------------------------------------

GRID = "points_per_shortest_wavelength = { fast = 4, full = 8 }"
LOAD, HEAD = "mean_pressure = 5.0e8", "[load]"
ROUGH = SMALL_CASE.partition("[surface]\n")[2].partition("\n\n")[0]
WAVE = 'kind = "sinusoid"\nperiod = 1e-3\nshape = [8]\namplitude = 1e-6'
TOTAL = 'quantity = "area.total.corrected"\nof = "bem"\nagainst = "persson"'
MEASURED = 'quantity = "quantity.measured_force"\nof = "persson"\nagainst = 0.0\nsource = "0"'
OMIT = '[[omit]]\nof = "bem"\nquantity = "quantity.measured_gab"\nbecause = "x"\n[load]'

#: What is replaced in the file, by what, and what the sentence says: the key and the remedy.
MISTAKES = [
    # names
    ("hurst =", "hurts =", r"surface\.hurts is no key of a case file; did you mean 'hurst'\?"),
    ("[theory]", "[theroy]", "theroy is no key .* did you mean 'theory'"),
    ("tolerance", "tolerence", r"gate 1\.tolerence is no key .* 'tolerance'"),
    ('kind = "self_affine"', 'kind = "selfaffine"', r"surface\.kind must be one of .* self_affine"),
    ('["persson", "bem"]', '["persson", "bme"]', "methods.* 'bme'; did you mean 'bem'"),
    ('["persson", "bem"]', '["bem", "bem"]', "bem is named 2 times"),
    ('against = "persson"', 'against = "herz"', "'herz', which is neither .* 'hertz'"),
    ("area.total.corrected", "area.total.corected", r"did you mean 'area\.total\.corrected'"),
    ("area.total.corrected", "quantity.stiffness_x", "gate 1: no quantity is called"),
    ("fast = 4", "fats = 4", r"surface\.points_per\w+ has 'fats', .* did you mean 'fast'"),
    (GRID[33:], "{ fats = 4, ful = 8 }", "has the keys 'fats', 'ful'.* did you mean 'fast'"),
    (HEAD, OMIT, "'quantity.measured_gab' of bem, which is no default gate; did you mean"),
    ('id = "small"', 'id = "other"', "case.id is 'other', but must be the file's name, 'small'"),
    # types and tables
    ("[[gate]]", "[gate]", r"\[gate\] is one table of a list; write \[\[gate\]\]"),
    ("[theory]", "[[theory]]", r"theory is \[\{.* but must be a table"),
    ("period = 1", 'period = "1e-3"  # ', r"surface\.period\[0\] is '1e-3', but must be a valid"),
    ("rms_slope = 0.1", "", r"surface\.rms_slope is missing; add it \(m/m"),
    (f"[load]\n{LOAD}", "", r"load is missing; add it \(a table \[load\]\)"),
    ("rms_slope = 0.1", 'rms_slope = "steep"', r"rms_slope is 'steep', but must be a valid number"),
    ("rms_slope = 0.1", "rms_slope = true", "rms_slope is True"),
    (LOAD, "mean_pressure = true", r"load\.mean_pressure is True"),
    ("full = 8 }", "full = { a = 8.5 } }", "points_per.* has the keys 'a', but must be one value"),
    ("[theory]\nenergy_reduction = 0.536", "", r"needs a table \[theory\]"),
    (ROUGH, WAVE, r"theory\.spectrum is 'analytic', but a surface of kind sinusoid is not drawn"),
    # numbers
    ("= 100.0e9", "= -1.0", "young_modulus is -1.0, but must be a positive number in Pa"),
    ("poisson_ratio = 0.3", "poisson_ratio = 0.5", "between -1 and 0.5"),
    ("poisson_ratio = 0.3", "poisson_ratio = -1.0", "between -1 and 0.5"),
    ("poisson_ratio = 0.3", "poisson_ratio = nan", "poisson_ratio is nan"),
    ("rms_slope = 0.1", "rms_slope = nan", "rms_slope.* nan"),
    ("period = 1", "period = [1e-3, 1e-7] # ", "are 0 on a period of 1e-07 m, but at least 2"),
    (LOAD, "mean_pressure = 6.0e9", r"\[load\] mean_pressure is 6e\+09 Pa, .* below the hardness"),
    (LOAD, "mean_pressure = -1.0", "mean_pressure is -1.0, but must be a positive number"),
    (LOAD, "mean_pressure = []", "mean_pressure is an empty path"),
    (LOAD, "mean_pressure = [2.0e8, 1.0e8]", "mean_pressure decreases .* non-decreasing"),
    ("_roll_off = 1.25", "_roll_off = 9.25", "wavenumber.* order"),
    (GRID, "shape = [8, 8]", "wavenumber_high .* needs at least"),
    ("seeds", "shape = [64, 64]\nseeds", "either .*points_per|points_per.* either"),
    ("[3, 5, 7]", "[3, 5, 3]", "seeds.* once"),
    ("[3, 5, 7]", "[-3]", "seeds.* greater than or equal to 0"),
    ("[3, 5, 7]", "[]", "seeds.* at least 1"),
    ("full = 8 }", 'full = "8" }', "points_per.* is '8'"),
    (HEAD, "[body]\ndepth = 1.0\n[load]", r"\[body\] depth is 1.0"),
    (HEAD, '[body]\nkind = "bonded_layer"\n[load]', r"\[body\] depth is inf.* in m"),
    # gates that cannot be answered, cannot fail, cannot hold or are never asked
    ('["persson", "bem"]', '["bem"]', "gate 1: reads persson, which case.methods does not name"),
    ('against = "persson"', 'against = "heights"', "heights has no 'area.total.corrected'; it has"),
    ('"area.total.corrected"', '"field.pressure"\nnorm = "l2"', "give a closed form that has it"),
    ('against = "persson"', "against = 0.1", "gate 1: against is a number without a source"),
    ('against = "persson"', 'against = nan\nsource = "x"', "against is nan.* finite"),
    ('against = "persson"', 'against = "bem"', "compared with itself"),
    ("tolerance = 0.5", "tolerance = 1\nbetween = [0, 1]", "give either tolerance or between"),
    ("tolerance = 0.5", "tolerance = -1.0", r"gate 1\.tolerance is -1.0, but must be greater"),
    ("tolerance = 0.5", "tolerance = inf", "tolerance is inf, but must be a finite number"),
    ("tolerance = 0.5", "between = [1, 0]", "between is out of order"),
    ("tolerance = 0.5", "between = [-inf, inf]", "holds whatever the difference is"),
    ("tolerance = 0.5", 'tolerance = 1\nsizes = ["ful"]', "'fast', 'full' or 'large'"),
    ("tolerance = 0.5", "tolerance = 1\nsizes = []", "at least 1"),
    ("tolerance = 0.5", 'tolerance = 1\nsizes = ["full"]', "no gate applies to size 'fast'"),
    ("tolerance = 0.5", f"tolerance = 1\nsizes = {list(SIZES)}", "applies to size 'large', which"),
    ("tolerance = 0.5", 'tolerance = 1\nnorm = "l2"', "a field, and nothing else, has"),
    ("tolerance = 0.5", 'tolerance = 1\nnorm = "supremum"', "a distribution, and nothing else"),
    ("area.total.corrected", "quantity.model_area", "gate 1: .* needs a gate of fem or tamaas_j2"),
    (TOTAL, MEASURED, r"gate 1: quantity\.measured_force .* persson has none"),
]
#: The same of a case of the finite elements.
OF_J2 = [
    ('law = "j2"', 'law = "capped"', "needs fem.law = 'j2', but it is 'capped'"),
    ('law = "j2"', 'law = "j2"\ngeometry = "moved"', "needs fem.geometry = 'gap'"),
    (LOAD[:16] + "5.7692e+08", "mean_pressure = [1e8, 2e8]", "needs a single load.mean_pressure"),
    ("hardness = 6.9231e+09", "hardness = inf", "needs a finite material.hardness"),
    ("hardness = 6.9231e+09", "", r"\[material\] has a yield_stress and no hardness"),
    ("yield_stress = 2.3077e+09", "", r"fem\.law is 'j2', but \[material\] yield_stress is missi"),
    ('law = "j2"', 'law = "j2"\nsteps = 4\nstep_tolerance = 0.1', "give either steps or step_tol"),
    ('law = "j2"', 'law = "elastic"\nsteps = 4', "steps has no effect on law 'elastic'"),
    ('law = "j2"', 'law = "capped"\nstep_tolerance = 0.1', "step_tolerance is for law 'j2', but"),
]


def sentence_of(path: Path) -> str:
    """The one sentence that refuses a file; it begins with the file's name."""
    with pytest.raises(InvalidCase) as caught:
        load_case(path)
    sentence = str(caught.value)
    assert sentence.startswith(f"{path}: ")
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize(("old", "new", "says"), MISTAKES)
def test_mistake_is_one_sentence(write_case, old: str, new: str, says: str) -> None:
    assert re.search(says, sentence_of(write_case((old, new))))


@pytest.mark.parametrize(("old", "new", "says"), OF_J2)
def test_mistake_about_flow_is_one_sentence(tmp_path, old: str, new: str, says: str) -> None:
    text = J2_CASE + MODEL_GATE
    assert old in text
    path = tmp_path / "fem-model-5.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidCase, match=says):
        load_case(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xff\xfe[case]", "is not UTF-8 text"),
        (b"[case\nid = 1", "is not TOML"),
        (b"x = " + b"[" * 100_000, "a case file"),
        (b"#" * (2 << 20), "is larger than"),
        (b"variant = 3", r"variant is 3, but must be tables \[\[variant\]\]"),
    ],
)
def test_what_is_no_case_file_is_refused(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    assert re.search(says, sentence_of(path))


def refusals(path: Path) -> list[str]:
    """What the command line says of a file, less the file's name; it must write nothing."""
    output = path.parent / "output"
    done = invoke("verify", path, "--output", output)
    assert (done.returncode, done.stdout, output.exists()) == (2, "", False)
    start = f"epcontact: {path}: "
    assert all(line.startswith(start) for line in done.stderr.splitlines())
    return [line.removeprefix(start) for line in done.stderr.splitlines()]


def test_all_mistakes_of_a_table_are_told_at_once(write_case) -> None:
    # Names, types, ranges and quantities; a misspelt key is not told to be missing, too.
    path = write_case(
        ("hurst = 0.8", "hurts = 0.8"),
        ("rms_slope = 0.1", 'rms_slope = "steep"'),
        ("young_modulus = 100.0e9", "young_modulus = -1.0"),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.7"),
        (LOAD, 'mean_pressure = [5.0e8, "x"]'),
        ("area.total.corrected", "area.total.corected"),
    )
    assert refusals(path) == [
        "surface.rms_slope is 'steep', but must be a valid number",
        "surface.hurts is no key of a case file; did you mean 'hurst'?",
        "[material] young_modulus is -1.0, but must be a positive number in Pa",
        "[material] poisson_ratio is 0.7, but must be a number between -1 and 0.5, both excluded",
        "load.mean_pressure[1] is 'x', but must be a valid number",
        "gate 1: no quantity is called 'area.total.corected'; did you mean 'area.total.corrected'?",
    ]


def test_all_mistakes_between_tables_are_told_at_once(write_case) -> None:
    edits = (('id = "small"', 'id = "other"'), ('["persson", "bem"]', '["bem"]'), (HEAD, OMIT))
    assert refusals(write_case(*edits, (LOAD, "mean_pressure = 7.0e9"))) == [
        "case.id is 'other', but must be the file's name, 'small'",
        "[load] mean_pressure is 7e+09 Pa, but must stay below the hardness of 6e+09 Pa",
        "gate 1: reads persson, which case.methods does not name; add it there",
        "omit has 'quantity.measured_gab' of bem, which is no default gate; did you mean "
        "'quantity.measured_gap'?",
    ]


def test_mistakes_of_sizes_and_at_each_size_are_told_once(write_case) -> None:
    values = ("hurst = 0.8", "hurst = { fast = 0.8, full = 2.0 }")
    assert refusals(write_case(values, (GRID, GRID.replace("4", "1").replace("8", "2")))) == [
        "surface.points_per_shortest_wavelength is 1, but must be greater than or equal to 3",
        "surface.hurst is 2.0, but must be less than or equal to 1",
    ]
    values = ("hurst = 0.8", "hurst = { fast = 0.8, ful = 2.0 }")
    assert refusals(write_case(values, ("fast = 4", "fats = 4"))) == [
        "surface.hurst has 'ful', which is no size; did you mean 'full'?",
        "surface.points_per_shortest_wavelength has 'fats', which is no size; did you mean 'fast'?",
    ]


def test_values_without_a_size_in_common_are_refused(write_case) -> None:
    path = write_case(("hurst = 0.8", "hurst = { full = 0.8 }"), ("fast = 4, full = 8", "fast = 4"))
    (sentence,) = refusals(path)
    assert sentence.startswith("the values that are given by size have no size in common")


def test_what_is_hardly_a_case_file_is_told_some_of_its_mistakes(tmp_path) -> None:
    path = tmp_path / "small.toml"
    path.write_text("".join(f"x{n} = 1\n" for n in range(30)))
    *told, last = refusals(path)
    assert told[0] == "case is missing; add it (a table [case])"
    assert (len(told), last) == (20, "there are 14 more mistakes")


def test_misspelt_size_of_a_bare_verify_is_refused() -> None:
    with pytest.raises(InvalidCase, match="no size is called 'fats'; did you mean 'fast'"):
        verify(size="fats")


# --- default gates -------------------------------------------------------------------------------

OWN_GAP = """
[[gate]]
quantity = "quantity.measured_gap"
of = "bem"
against = 0.0
norm = "absolute"
tolerance = 1e-3
source = "a test"
because = "a band of the case's own"
"""
NO_GAP = (
    '[[omit]]\nquantity = "quantity.measured_gap"\nof = "bem"\nbecause = "The test wants it."\n'
)


def bands(case) -> dict[tuple[str, str], float]:
    return {(gate.of, gate.quantity): gate.high for gate in case.gates}


def test_a_case_has_the_default_gates_of_its_methods(write_case) -> None:
    names = {(gate.of, gate.quantity) for gate in default_gates() if gate.of == "bem"}
    assert names == {("bem", q) for q in QUANTITIES if q.startswith("quantity.measured_")} - {
        ("bem", f"quantity.measured_{name}")
        for name in ("raw_total", "raw_plastic", "carried", "distribution", "residuals")
    }
    own = bands(load_case(write_case()))
    assert own[("bem", "quantity.measured_gap")] == 1e-7
    assert set(own) == names | {("bem", "area.total.corrected")}


def test_a_case_changes_or_omits_a_default_gate(write_case) -> None:
    path, gap = write_case(), ("bem", "quantity.measured_gap")
    text, before = path.read_text(), bands(load_case(path))
    path.write_text(text + OWN_GAP)
    assert bands(load_case(path)) == before | {gap: 1e-3}
    path.write_text(text + NO_GAP)
    case = load_case(path)
    assert bands(case) == {key: band for key, band in before.items() if key != gap}
    assert case.not_judged == (
        "default gate quantity.measured_gap of bem is omitted: The test wants it.",
    )
    assert len(load_case("paper-8192-32-elastic", "large").gates) == 1  # its own alone


# --- families and names --------------------------------------------------------------------------

VARIANTS = """
[[variant]]
case = { id = "soft" }
material = { young_modulus = 50.0e9 }

[[variant]]
case = { id = "stiff", requirement = "A stiff one." }
gate = [
  { quantity = "area.total.corrected", tolerance = 0.1, because = "It is stiff." },
  { quantity = "quantity.mean_gap", of = "bem", against = "persson", tolerance = 2, because = "-" },
]
"""


@pytest.fixture
def write_family(write_case):
    def write(*replacements: tuple[str, str]) -> Path:
        path = write_case()
        text = path.read_text() + VARIANTS
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        path.write_text(text)
        return path

    return write


def test_variants_are_laid_over_the_rest_of_the_file(write_family) -> None:
    soft, stiff = (load_case(text) for text in find_named(write_family()))
    assert (soft.id, stiff.id, stiff.requirement) == ("soft", "stiff", "A stiff one.")
    assert (soft.material.young_modulus, stiff.material.young_modulus) == (50e9, 100e9)
    assert soft.material.hardness == stiff.material.hardness == 6e9
    assert bands(soft)[("bem", "area.total.corrected")] == 0.5
    assert bands(stiff)[("bem", "area.total.corrected")] == 0.1
    assert bands(stiff)[("bem", "quantity.mean_gap")] == 2
    assert stiff.gates[0].because == "It is stiff."
    with pytest.raises(InvalidCase, match="holds 2 cases; name one of them: soft, stiff"):
        load_case(write_family())


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("young_modulus = 50", "yuong_modulus = 50", "variant soft: .* did you mean 'young_mod"),
        ("material = { y", "materiel = { y", "variant soft: .* did you mean 'material'"),
        ('id = "stiff", ', "", "variant 2 has the case.id None"),
        ('id = "stiff"', 'id = "soft"', "variant 2 has the case.id 'soft'"),
        ("tolerance = 0.1,", "tolerence = 0.1,", r"variant stiff: gate 1\.tolerence .*'tolerance'"),
        ('"quantity.mean_gap", of', '"quantity.mean_gab", fo', r"variant stiff: gate 2\.fo .* of,"),
    ],
)
def test_mistakes_in_variants_name_file_variant_and_key(write_family, old, new, says) -> None:
    path = write_family((old, new))
    with pytest.raises(InvalidCase, match=f"{re.escape(str(path))}: {says}"):
        _ = [load_case(text) for text in find_named(path)]


def test_a_mistake_that_variants_share_is_told_once(write_family) -> None:
    path = write_family(("hurst =", "hurts ="), ("tolerance = 0.1,", "tolerence = 0.1,"))
    assert refusals(path) == [
        "variant soft: surface.hurts is no key of a case file; did you mean 'hurst'?",
        "variant stiff: gate 1.tolerence is no key of a case file; did you mean 'tolerance'?",
    ]


def test_a_gate_that_two_gates_could_mean_is_refused(write_family) -> None:
    path = write_family()
    gate = path.read_text().partition("[[gate]]")[2].partition("[[variant]]")[0]
    path.write_text(path.read_text().replace("[[variant]]", f"[[gate]]{gate}\n[[variant]]", 1))
    with pytest.raises(InvalidCase, match="2 gates of the file have the quantity"):
        find_named(path)


def test_cases_are_found_by_name_file_and_path(write_case, tmp_path, monkeypatch) -> None:
    assert find_case("fem-model-50-nu0").path.name == "fem-model.toml"
    assert len(find_named("fem-model")) == 9
    ids = [case.id for case in find_cases()]
    assert len(ids) == len(set(ids))
    with pytest.raises(InvalidCase, match="did you mean 'fem-model-50-nu0'"):
        find_case("fem-modl-50-nu0")
    # A folder of own cases does not hide those of the package, nor one of results a case.
    own = tmp_path / "cases"
    own.mkdir()
    (tmp_path / "paper-elastic").mkdir()
    (tmp_path / "other").mkdir()
    write_case().rename(own / "mine.toml")
    (own / "broken.toml").write_text("[")
    monkeypatch.chdir(tmp_path)
    assert [case.path.name for case in find_named("mine")] == ["mine.toml"]
    assert find_named("paper-elastic")[0].path.is_absolute()
    for name, says in (("paper-elastik", "'paper-elastic'"), ("other", "no such case file")):
        with pytest.raises(InvalidCase, match=says):
            find_named(name)


# --- papers --------------------------------------------------------------------------------------


def test_papers_are_different_and_their_identifiers_well_formed() -> None:
    identifiers = [paper.doi for paper in PAPERS if paper.doi]
    assert len(set(identifiers)) == len(identifiers)
    assert all(re.fullmatch(r"10\.\d{4,9}/\S+", doi) for doi in identifiers)
    own = {name for name, method in METHODS.items() if not method.foreign}
    assert {name for paper in PAPERS for name in paper.methods} == own


def test_an_option_is_cited(write_case) -> None:
    old = "energy_reduction = 0.536"
    plain = load_case(write_case())
    other = load_case(write_case((old, f'{old}\nreduction = "wang_muser"'), name="other"))
    (more,) = set(papers_of(other)) - set(papers_of(plain))
    assert str(more).endswith("https://doi.org/10.1007/s11249-017-0886-9")


def test_a_citation_holds_sources_papers_and_versions() -> None:
    for name in ("westergaard-light", "paper-elastoplastic"):
        case = load_case(name)
        lines = list(citation(case))
        assert {f"  {text}" for text in (*sources_of(case), *papers_of(case))} <= set(lines)
        assert any(re.match(r"  numpy \d+\.\d+.* https://doi.org/10\.", line) for line in lines)
    done = invoke("cite", "westergaard-light")
    assert (done.returncode, done.stderr) == (0, "")
    assert "10.1115/1.4008919" in done.stdout
    assert "did you mean" in invoke("cite", "westergard-light").stderr
