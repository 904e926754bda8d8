"""Case files: what is read is what was written, by size, by variant and with its default gates."""

from __future__ import annotations

import math
import re

import pytest
from command_line import invoke
from conftest import VARIANTS

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import find_case, find_cases, find_named, load_case
from epcontact.harness.case_files.citations import PAPERS, papers_of, sources_of
from epcontact.harness.case_files.model import default_gates
from epcontact.harness.case_files.text import at_size
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES


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
    other = case.changed(methods=("bem",), id="other")
    assert (other.methods, other.id, other.gates) == (("bem",), "other", case.gates)
    assert (case.methods, case.id) == (("persson", "bem"), "small")
    with pytest.raises(AttributeError):
        case.changed(method="bem")


def test_byte_order_mark_and_line_ends_of_windows(write_case) -> None:
    path = write_case()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load_case(path).id == "small"


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


def test_variants_are_laid_over_the_rest_of_the_file(write_case) -> None:
    soft, stiff = (load_case(text) for text in find_named(write_case(more=VARIANTS)))
    assert (soft.id, stiff.id, stiff.head.requirement) == ("soft", "stiff", "A stiff one.")
    assert (soft.material.young_modulus, stiff.material.young_modulus) == (50e9, 100e9)
    assert soft.material.hardness == stiff.material.hardness == 6e9
    assert bands(soft)[("bem", "area.total.corrected")] == 0.5
    assert bands(stiff)[("bem", "area.total.corrected")] == 0.1
    assert bands(stiff)[("bem", "quantity.mean_gap")] == 2
    assert stiff.gates[0].because == "It is stiff."
    with pytest.raises(InvalidCase, match="holds 2 cases; name one of them: soft, stiff"):
        load_case(write_case(more=VARIANTS))


def test_cases_are_found_by_name_file_and_path(write_case, tmp_path, monkeypatch) -> None:
    assert find_case("fem-model-50-nu0").path.name == "fem-model.toml"
    assert len(find_named("fem-model")) == 9
    with pytest.raises(InvalidCase, match="did you mean 'fem-model-50-nu0'"):
        find_case("fem-modl-50-nu0")
    # A folder of own cases does not hide those of the package, nor one of results a case.
    for folder in ("cases", "paper-elastic", "other"):
        (tmp_path / folder).mkdir()
    write_case().rename(tmp_path / "cases" / "mine.toml")
    (tmp_path / "cases" / "broken.toml").write_text("[")
    monkeypatch.chdir(tmp_path)
    assert [case.path.name for case in find_named("mine")] == ["mine.toml"]
    assert find_named("paper-elastic")[0].path.is_absolute()
    for name, says in (("paper-elastik", "'paper-elastic'"), ("other", "no such case file")):
        with pytest.raises(InvalidCase, match=says):
            find_named(name)


def test_every_shipped_case_reads_at_every_size_and_cites_papers() -> None:
    cases = [load_case(text, size) for text in find_cases() for size in text.sizes]
    assert len({(case.id, case.size) for case in cases}) == len(cases)
    assert all(case.gates or case.sweep for case in cases)
    assert all(len(gate.because) > 10 for case in cases for gate in case.gates)
    assert all(papers_of(case) for case in cases)
    assert {paper for case in cases for paper in papers_of(case)} == set(PAPERS)
    identifiers = [paper.doi for paper in PAPERS if paper.doi]
    assert len(set(identifiers)) == len(identifiers)
    assert all(re.fullmatch(r"10\.\d{4,9}/\S+", doi) for doi in identifiers)
    own = {name for name, method in METHODS.items() if not method.foreign}
    assert {name for paper in PAPERS for name in paper.methods} == own


def test_a_citation_holds_sources_papers_and_versions(write_case) -> None:
    old = "energy_reduction = 0.536"
    plain = load_case(write_case())
    other = load_case(write_case((old, f'{old}\nreduction = "wang_muser"'), name="other"))
    (more,) = set(papers_of(other)) - set(papers_of(plain))  # of the option
    assert str(more).endswith("https://doi.org/10.1007/s11249-017-0886-9")
    done = invoke("cite", "westergaard-light")
    assert (done.returncode, done.stderr) == (0, "")
    case = load_case("westergaard-light")
    assert all(f"  {text}\n" in done.stdout for text in (*sources_of(case), *papers_of(case)))
    assert re.search(r"  numpy \d+\.\d+.* https://doi.org/10\.", done.stdout)
