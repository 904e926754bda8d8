"""The papers behind methods, closed forms and gates, and the software, that a result
rests on.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files

from epcontact.harness.case_files.model import Case
from epcontact.reference import CLOSED_FORMS
from epcontact.results import package_versions

_RESOLVER = "https://doi.org/"
_DATA = tomllib.loads((files(__package__) / "papers.toml").read_text("utf-8"))


@dataclass(frozen=True, eq=False)
class Paper:
    """A published work; `papers.toml` says what its entries mean."""

    text: str
    doi: str = ""
    methods: Sequence[str] = ()
    mentions: Sequence[str] = ()

    def __str__(self) -> str:
        return f"{self.text} {_RESOLVER}{self.doi}" if self.doi else self.text


PAPERS = [Paper(**paper) for paper in _DATA["paper"]]


def sources_of(case: Case) -> list[str]:
    """Return the sources that a case, its gates and their closed forms name, each
    once.
    """
    forms = [
        CLOSED_FORMS[str(g.against)]
        for g in case.gates
        if str(g.against) in CLOSED_FORMS
    ]
    named = [
        case.head.source,
        *(g.source for g in case.gates),
        *(form.source for form in forms),
    ]
    return list(dict.fromkeys(source for source in named if source))


def papers_of(case: Case) -> list[Paper]:
    """Return the papers of a case's methods, and those that its sources or options
    mention.
    """
    values = [
        str(value) for options in case.options.values() for value in options.values()
    ]
    text = "\n".join([*sources_of(case), *values])
    return [
        paper
        for paper in PAPERS
        if set(paper.methods) & set(case.methods)
        or any(words in text for words in paper.mentions)
    ]


def citation(case: Case) -> Iterator[str]:
    """Yield the lines that tell what a case's results rest on: sources, papers and
    software.
    """
    yield f"{case.id}: {case.head.requirement}"
    yield "\nSources that the case names:"
    yield from (f"  {source}" for source in sources_of(case))
    yield "\nPapers:"
    yield from (f"  {paper}" for paper in papers_of(case))
    yield (
        "\nSoftware, as installed here (a result's own versions are in its JSON file):"
    )
    for name, version in package_versions().items():
        doi = _DATA["software"].get(name)
        yield f"  {name} {version}" + (f" {_RESOLVER}{doi}" if doi else "")
