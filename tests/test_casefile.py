"""Case files: what is read is what was written, and all mistakes are told, each in a sentence."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from command_line import invoke
from fem_scenes import J2_CASE, MODEL_GATE

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import (
    case_sizes,
    find_case,
    find_cases,
    find_named,
    load_case,
)
from epcontact.harness.case_files.tables import default_gates
from epcontact.harness.case_files.text import at_size
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.verification import verify


def test_sizes_replace_every_table_of_sizes() -> None:
    data = {"a": {"fast": 1, "full": 2}, "b": [{"c": {"fast": 3, "full": 4}}], "d": {"e": 5}}
    assert at_size(data, "full") == {"a": 2, "b": [{"c": 4}], "d": {"e": 5}}


def test_case_becomes_scenes(write_case) -> None:
    case = load_case(write_case(), "full")
    assert [r.seed for r in case.recipes] == [3, 5, 7]
    assert case.recipes[0].shape == (64, 64)
    assert case.material.hardness == 6.0e9
    assert case.options["persson"]["energy_reduction"] == 0.536


def test_digest_is_known_before_the_surface_is_made(write_case) -> None:
    case = load_case(write_case())
    for recipe in case.recipes:
        assert case.digest(recipe) == case.scene(recipe).digest
    assert len({case.digest(recipe) for recipe in case.recipes}) == 3


def test_every_shipped_case_reads_at_every_size() -> None:
    paths = find_cases()
    assert len(paths) >= 2
    for path in paths:
        for size in case_sizes(path):
            case = load_case(path, size)
            assert case.gates or case.sweep
            assert all(len(gate.because) > 10 for gate in case.gates)


# What is done to the file, and what the sentence must name: the key and the remedy.
MISTAKES = {
    "unknown key": (("hurst =", "hurts ="), ["hurts", "did you mean 'hurst'"]),
    "table for a list of tables": (
        ("[[gate]]", "[gate]"),
        ["[gate] is one table", "write [[gate]]"],
    ),
    "list of tables for a table": (("[theory]", "[[theory]]"), ["theory is [{", "must be a table"]),
    "a word for a length": (("period = 1", 'period = "1e-3"  # '), ["period", "a valid number"]),
    "a period without points": (
        ("period = 1", "period = [1e-3, 1e-7] # "),
        ["are 0 on a period of 1e-07 m, but at least 2 are needed"],
    ),
    "unknown table": (("[theory]", "[theroy]"), ["theroy", "did you mean 'theory'"]),
    "unknown key in a gate": (("tolerance", "tolerence"), ["tolerence", "'tolerance'"]),
    "missing key": (("rms_slope = 0.1", ""), ["surface.rms_slope", "missing", "m/m"]),
    "missing table": (("[load]\nmean_pressure = 5.0e8", ""), ["load is missing", "[load]"]),
    "wrong type": (("rms_slope = 0.1", 'rms_slope = "steep"'), ["rms_slope", "'steep'", "number"]),
    "boolean for a number": (("rms_slope = 0.1", "rms_slope = true"), ["rms_slope", "True"]),
    "negative modulus": (("= 100.0e9", "= -1.0"), ["young_modulus", "positive"]),
    "Poisson's ratio": (("poisson_ratio = 0.3", "poisson_ratio = 0.5"), ["between -1 and 0.5"]),
    "Poisson's ratio below": (("poisson_ratio = 0.3", "poisson_ratio = -1.0"), ["between -1"]),
    "NaN": (("poisson_ratio = 0.3", "poisson_ratio = nan"), ["poisson_ratio", "nan"]),
    "NaN slope": (("rms_slope = 0.1", "rms_slope = nan"), ["rms_slope", "nan"]),
    "pressure at the hardness": (("mean_pressure = 5.0e8", "mean_pressure = 6.0e9"), ["hardness"]),
    "negative pressure": (("mean_pressure = 5.0e8", "mean_pressure = -1.0"), ["mean_pressure"]),
    "empty path": (("mean_pressure = 5.0e8", "mean_pressure = []"), ["mean_pressure", "empty"]),
    "unloading": (
        ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 1.0e8]"),
        ["mean_pressure", "decreases", "non-decreasing"],
    ),
    "wavenumbers": (("_roll_off = 1.25", "_roll_off = 9.25"), ["wavenumber", "order"]),
    "too much roughness": (
        ("points_per_shortest_wavelength = { fast = 4, full = 8 }", "shape = [8, 8]"),
        ["wavenumber_high", "needs at least"],
    ),
    "both resolutions": (("seeds", "shape = [64, 64]\nseeds"), ["points_per", "either"]),
    "a seed twice": (("[3, 5, 7]", "[3, 5, 3]"), ["seeds", "once"]),
    "negative seed": (("[3, 5, 7]", "[-3]"), ["seeds", "greater than or equal to 0"]),
    "no seeds": (("[3, 5, 7]", "[]"), ["seeds"]),
    "kind": (('kind = "self_affine"', 'kind = "selfaffine"'), ["surface.kind", "self_affine"]),
    "method": (('["persson", "bem"]', '["persson", "bme"]'), ["methods", "bme"]),
    "gate of an absent method": (('["persson", "bem"]', '["bem"]'), ["gate 1", "persson", "add"]),
    "theory without gamma": (("[theory]\nenergy_reduction = 0.536", ""), ["[theory]"]),
    "closed form": (('against = "persson"', 'against = "herz"'), ["'herz'", "'hertz'"]),
    "number without source": (('against = "persson"', "against = 0.1"), ["gate", "source"]),
    "tolerance and between": (("tolerance = 0.5", "tolerance = 1\nbetween = [0, 1]"), ["either"]),
    "model of the boundary elements": (
        ('quantity = "area.total.corrected"', 'quantity = "quantity.model_area"'),
        [
            "gate 1",
            "model_area",
            "of fem or tamaas_j2 against a number or each other",
            "of bem against 'persson'",
        ],
    ),
    "size table": (("full = 8 }", "full = 8.5 }"), ["points_per", "8.5"]),
    "misspelt size": (("fast = 4", "fats = 4"), ["points_per", "'fats'", "did you mean 'fast'"]),
    "misspelt sizes": (
        ("{ fast = 4, full = 8 }", "{ fats = 4, ful = 8 }"),
        ["points_per", "'fats'", "did you mean 'fast'"],
    ),
    "no default gate": (
        (
            "[load]",
            '[[omit]]\nof = "bem"\nquantity = "quantity.measured_gab"\nbecause = "x"\n[load]',
        ),
        ["measured_gab", "no default gate", "did you mean 'quantity.measured_gap'"],
    ),
    "depth of a half-space": (("[load]", "[body]\ndepth = 1.0\n[load]"), ["[body]", "depth"]),
    "layer without depth": (
        ("[load]", '[body]\nkind = "bonded_layer"\n[load]'),
        ["[body]", "depth", "m"],
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake_is_one_sentence(write_case, mistake: str) -> None:
    replacement, words = MISTAKES[mistake]
    path = write_case(replacement)
    with pytest.raises(InvalidCase) as caught:
        load_case(path)
    sentence = str(caught.value)
    assert sentence.startswith(str(path))
    assert "\n" not in sentence
    for word in words:
        assert word in sentence


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"\xff\xfe[case]", "UTF-8"),
        (b"[case\nid = 1", "TOML"),
        (b"x = " + b"[" * 100_000, "case file"),
        (b"#" * (2 << 20), "larger"),
    ],
)
def test_what_is_no_case_file_is_refused(tmp_path: Path, content: bytes, word: str) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(InvalidCase, match=word) as caught:
        load_case(path)
    assert "\n" not in str(caught.value)


def refusals(path: Path) -> list[str]:
    """What the command line says of a file, less the file's name; it must write nothing."""
    output = path.parent / "output"
    done = invoke("verify", path, "--output", output)
    assert (done.returncode, done.stdout, output.exists()) == (2, "", False)
    start = f"epcontact: {path}: "
    assert all(line.startswith(start) for line in done.stderr.splitlines())
    return [line.removeprefix(start) for line in done.stderr.splitlines()]


def test_all_mistakes_of_a_file_are_told_at_once(write_case) -> None:
    # Names, types, ranges and quantities; a misspelt key is not told to be missing, too.
    path = write_case(
        ("hurst = 0.8", "hurts = 0.8"),
        ("rms_slope = 0.1", 'rms_slope = "steep"'),
        ("young_modulus = 100.0e9", "young_modulus = -1.0"),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.7"),
        ("mean_pressure = 5.0e8", 'mean_pressure = [5.0e8, "x"]'),
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
    omit = '[[omit]]\nof = "bem"\nquantity = "quantity.measured_gab"\nbecause = "x"\n[load]'
    path = write_case(
        ('id = "small"', 'id = "other"'),
        ('["persson", "bem"]', '["bem"]'),
        ("mean_pressure = 5.0e8", "mean_pressure = 7.0e9"),
        ("[load]", omit),
    )
    assert refusals(path) == [
        "case.id is 'other', but must be the file's name, 'small'",
        "[load] mean_pressure is 7e+09 Pa, but must stay below the hardness of 6e+09 Pa",
        "gate 1: reads persson, which case.methods does not name; add it there",
        "omit has 'quantity.measured_gab' of bem, which is no default gate; did you mean "
        "'quantity.measured_gap'?",
    ]


def test_mistakes_at_each_size_are_told_once(write_case) -> None:
    sizes = "points_per_shortest_wavelength = { fast = 4, full = 8 }"
    values = ("hurst = 0.8", "hurst = { fast = 0.8, full = 2.0 }")
    path = write_case(values, (sizes, sizes.replace("4", "1").replace("8", "2")))
    assert refusals(path) == [
        "surface.points_per_shortest_wavelength is 1, but must be greater than or equal to 3",
        "surface.hurst is 2.0, but must be less than or equal to 1",
    ]


def test_misspelt_sizes_are_told_together(write_case) -> None:
    values = ("hurst = 0.8", "hurst = { fast = 0.8, ful = 2.0 }")
    path = write_case(values, ("fast = 4", "fats = 4"))
    assert refusals(path) == [
        "surface.hurst has 'ful', which is no size; did you mean 'full'?",
        "surface.points_per_shortest_wavelength has 'fats', which is no size; did you mean 'fast'?",
    ]


def test_values_without_a_size_in_common_are_refused(write_case) -> None:
    values = ("hurst = 0.8", "hurst = { full = 0.8 }")
    path = write_case(values, ("fast = 4, full = 8", "fast = 4"))
    (sentence,) = refusals(path)
    assert sentence.startswith("the values that are given by size have no size in common")


def test_what_is_hardly_a_case_file_is_told_some_of_its_mistakes(tmp_path) -> None:
    path = tmp_path / "small.toml"
    path.write_text("".join(f"x{n} = 1\n" for n in range(30)))
    *told, last = refusals(path)
    assert told[0] == "case is missing; add it (a table [case])"
    assert (len(told), last) == (20, "there are 14 more mistakes")


def test_id_must_be_the_name_of_the_file(write_case, tmp_path: Path) -> None:
    path = write_case().rename(tmp_path / "other.toml")
    with pytest.raises(InvalidCase, match="must be the file's name, 'other'"):
        load_case(path)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('law = "j2"', 'law = "capped"', "needs fem.law = 'j2', but it is 'capped'"),
        ('law = "j2"', 'law = "j2"\ngeometry = "moved"', "fem.geometry = 'gap'"),
        ("mean_pressure = 5.7692e+08", "mean_pressure = [1e8, 2e8]", "single load.mean_pressure"),
    ],
)
def test_what_has_no_model_difference_cannot_gate_it(
    tmp_path: Path, old: str, new: str, word: str
) -> None:
    path = tmp_path / "fem-model-5.toml"
    text = J2_CASE + MODEL_GATE
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidCase, match=word) as caught:
        load_case(path)
    assert "gate 2: quantity.model_area" in str(caught.value)


@pytest.mark.parametrize(
    ("fem", "sentence"),
    [
        ('law = "j2"\nsteps = 4\nstep_tolerance = 0.1', "give either steps or step_tolerance"),
        ('law = "elastic"\nsteps = 4', "steps has no effect on law 'elastic'"),
        (
            'law = "capped"\nstep_tolerance = 0.1',
            "step_tolerance is for law 'j2', but law is 'capp",
        ),
    ],
)
def test_options_that_contradict_each_other_are_refused(tmp_path, fem: str, sentence: str) -> None:
    path = tmp_path / "fem-model-5.toml"
    path.write_text(J2_CASE.replace('law = "j2"', fem), encoding="utf-8")
    with pytest.raises(InvalidCase, match=rf"\[fem\] {sentence}"):
        load_case(path)


def test_infinite_hardness_is_the_default(write_case) -> None:
    assert load_case(write_case(("hardness = 6.0e9", ""))).material.hardness == math.inf


def test_misspelt_quantity_is_refused_with_the_nearest_name(write_case) -> None:
    with pytest.raises(InvalidCase, match=r"did you mean 'area\.total\.corrected'"):
        load_case(write_case(("area.total.corrected", "area.total.corected")))


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
NO_GAP = """
[[omit]]
quantity = "quantity.measured_gap"
of = "bem"
because = "The test wants a case without it."
"""


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
    path = write_case()
    text = path.read_text()
    before = bands(load_case(path))
    path.write_text(text + OWN_GAP)
    assert bands(load_case(path)) == before | {("bem", "quantity.measured_gap"): 1e-3}
    path.write_text(text + NO_GAP)
    del before[("bem", "quantity.measured_gap")]
    assert bands(load_case(path)) == before


def test_the_largest_size_has_the_case_s_own_gates_alone() -> None:
    assert len(load_case("paper-8192-32-elastic", "large").gates) == 1


# --- families ------------------------------------------------------------------------------------

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
    assert (soft.id, stiff.id) == ("soft", "stiff")
    assert (soft.material.young_modulus, stiff.material.young_modulus) == (50e9, 100e9)
    assert soft.material.hardness == stiff.material.hardness == 6e9
    assert stiff.requirement == "A stiff one."
    assert bands(soft)[("bem", "area.total.corrected")] == 0.5
    assert bands(stiff)[("bem", "area.total.corrected")] == 0.1
    assert bands(stiff)[("bem", "quantity.mean_gap")] == 2
    assert stiff.gates[0].because == "It is stiff."


def test_a_family_that_stands_for_one_case_is_refused(write_family) -> None:
    with pytest.raises(InvalidCase, match="holds 2 cases; name one of them: soft, stiff"):
        load_case(write_family())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("young_modulus = 50", "yuong_modulus = 50", ["variant soft", "did you mean 'young_mod"]),
        ("material = { y", "materiel = { y", ["variant soft", "did you mean 'material'"]),
        ('id = "stiff", ', "", ["variant 2", "case.id"]),
        ('id = "stiff"', 'id = "soft"', ["variant 2", "'soft'"]),
        (
            "tolerance = 0.1,",
            "tolerence = 0.1,",
            ["variant stiff: gate 1.tolerence", "'tolerance'"],
        ),
        (
            '"quantity.mean_gap", of',
            '"quantity.mean_gab", fo',
            ["variant stiff", "gate 2.fo", " of,"],
        ),
    ],
)
def test_mistakes_in_variants_name_file_variant_and_key(
    write_family, old: str, new: str, words: list[str]
) -> None:
    path = write_family((old, new))
    with pytest.raises(InvalidCase) as caught:
        _ = [load_case(text) for text in find_named(path)]
    for word in (str(path), *words):
        assert word in str(caught.value)


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


def test_shipped_families_are_found_by_the_ids_of_their_cases() -> None:
    assert find_case("fem-model-50-nu0").path.name == "fem-model.toml"
    assert len(find_named("fem-model")) == 9
    ids = [case.id for case in find_cases()]
    assert len(ids) == len(set(ids))
    with pytest.raises(InvalidCase, match="did you mean 'fem-model-50-nu0'"):
        find_case("fem-modl-50-nu0")


def test_a_measured_quantity_of_a_method_without_fields_is_refused(write_case) -> None:
    gate = 'quantity = "area.total.corrected"\nof = "bem"\nagainst = "persson"'
    measured = 'quantity = "quantity.measured_force"\nof = "persson"\nagainst = 0.0\nsource = "0"'
    with pytest.raises(InvalidCase, match=r"gate 1: quantity\.measured_force .* persson has none"):
        load_case(write_case((gate, measured)))


def test_the_registry_of_quantities_says_what_is_checked() -> None:
    for quantity in QUANTITIES.values():
        assert set(quantity.needs) <= {"fields", "J2 flow", "hardness"}
        assert quantity.measure is None or quantity.name.startswith("quantity.")


def test_a_folder_of_own_cases_does_not_hide_those_of_the_package(
    write_case, tmp_path, monkeypatch
) -> None:
    own = tmp_path / "cases"
    own.mkdir()
    write_case().rename(own / "mine.toml")
    (own / "broken.toml").write_text("[")
    monkeypatch.chdir(tmp_path)
    assert [case.path.name for case in find_named("mine")] == ["mine.toml"]
    assert find_named("paper-elastoplastic")[0].path.is_absolute()
    with pytest.raises(InvalidCase, match="paper-elastoplastic"):
        find_named("paper-elastoplastik")
