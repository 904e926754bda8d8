"""The publications and the software on which a case's results depend."""

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
    """A published work, from a table [[paper]] of `papers.toml`.

    Attributes:
        text: authors, title, journal and year.
        doi: its DOI, such as "10.1063/1.1388626"; empty: it has none.
        methods: the names of the methods that are based on it.
        mentions: words.  A case whose sources or options contain one of them uses the
            work.
    """

    text: str
    doi: str = ""
    methods: Sequence[str] = ()
    mentions: Sequence[str] = ()

    def __str__(self) -> str:
        """Return the text, followed by the web address of the DOI if there is one."""
        return self.text + _doi_address(self.doi)


def _doi_address(doi: str) -> str:
    """Return the web address of a DOI after a blank; "" if the DOI is empty."""
    return f" {_RESOLVER}{doi}" if doi else ""


#: All publications of `papers.toml`, in its order.
PAPERS = [Paper(**paper) for paper in _DATA["paper"]]


def sources_of(case: Case) -> list[str]:
    """Return the texts of the key `source` of a case and its gates, and the sources of
    the closed forms that its gates name; each text once.
    """
    sources = [case.head.source]
    sources += [gate.source for gate in case.gates]
    for gate in case.gates:
        form = CLOSED_FORMS.get(str(gate.against))
        if form is not None:
            sources.append(form.source)
    return list(dict.fromkeys(source for source in sources if source))


def papers_of(case: Case) -> list[Paper]:
    """Return the publications on which a case depends, in the order of `PAPERS`.

    These are the ones of its methods, and those whose words (`Paper.mentions`) are in
    its sources or in the values of its options.
    """
    texts = sources_of(case)
    for options in case.options.values():
        texts += [str(value) for value in options.values()]
    text = "\n".join(texts)
    papers = []
    for paper in PAPERS:
        of_method = not set(paper.methods).isdisjoint(case.methods)
        if of_method or any(words in text for words in paper.mentions):
            papers.append(paper)
    return papers


def citation(case: Case) -> Iterator[str]:
    """Yield the lines that `epcontact cite` prints for a case.

    The lines list the requirement, the sources that the case names, the publications of
    its methods, and the installed versions of the software.
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
        doi = _DATA["software"].get(name, "")
        yield f"  {name} {version}{_doi_address(doi)}"
