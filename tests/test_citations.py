"""`epcontact cite`: what a result rests on."""

from __future__ import annotations

import re

import pytest
from command_line import invoke

from epcontact.harness.case_files.case import find_cases, load_case
from epcontact.harness.case_files.citations import PAPERS, citation, papers_of, sources_of
from epcontact.harness.methods.registry import METHODS


def test_papers_are_different_and_their_identifiers_well_formed() -> None:
    identifiers = [paper.doi for paper in PAPERS if paper.doi]
    assert len(set(identifiers)) == len(identifiers)
    assert all(re.fullmatch(r"10\.\d{4,9}/\S+", doi) for doi in identifiers)
    own = {name for name, method in METHODS.items() if not method.foreign}
    assert {name for paper in PAPERS for name in paper.methods} == own


def test_every_mention_is_found_in_a_case_and_every_case_has_a_paper() -> None:
    cases = [load_case(text, text.sizes[0]) for text in find_cases()]
    cited = {paper for case in cases for paper in papers_of(case)}
    assert [p for p in PAPERS if p not in cited] == []
    assert [case.id for case in cases if not papers_of(case)] == []


def test_an_option_is_cited(write_case) -> None:
    old = "energy_reduction = 0.536"
    plain = load_case(write_case())
    other = load_case(write_case((old, f'{old}\nreduction = "wang_muser"'), name="other"))
    (more,) = set(papers_of(other)) - set(papers_of(plain))
    assert more.doi == "10.1007/s11249-017-0886-9"
    assert str(more).endswith("https://doi.org/10.1007/s11249-017-0886-9")


@pytest.mark.parametrize("name", ["westergaard-light", "paper-elastoplastic"])
def test_lines_hold_sources_papers_and_versions(name) -> None:
    case = load_case(name)
    lines = list(citation(case))
    assert all(f"  {source}" in lines for source in sources_of(case))
    assert all(f"  {paper}" in lines for paper in papers_of(case))
    assert any(re.match(r"  numpy \d+\.\d+.* https://doi.org/10\.", line) for line in lines)


def test_command_line() -> None:
    done = invoke("cite", "westergaard-light")
    assert (done.returncode, done.stderr) == (0, "")
    assert "10.1115/1.4008919" in done.stdout
    assert "did you mean" in invoke("cite", "westergard-light").stderr
