"""What a result rests on: the papers behind methods, closed forms and gates, and the software.

A paper is cited for a case if the case uses a method that rests on it, or if a source that the case
or one of its closed forms names mentions it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from epcontact.harness.case_files.case import Case
from epcontact.reference import CLOSED_FORMS
from epcontact.results import package_versions

_RESOLVER = "https://doi.org/"


@dataclass(frozen=True)
class Paper:
    """A published work.

    Attributes:
        text: authors, title, journal and year.
        doi: its digital object identifier; empty if it has none.
        methods: the methods that rest on it.
        mentions: words of a source, or values of a method's options, that mean this paper.
    """

    text: str
    doi: str = ""
    methods: tuple[str, ...] = ()
    mentions: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.text} {_RESOLVER}{self.doi}" if self.doi else self.text


PAPERS = (
    Paper(
        "A. Almqvist and B. N. J. Persson, Multiscale contact mechanics for elastoplastic contacts "
        "(2025).",
        methods=("persson", "bem"),
        mentions=("Almqvist and Persson",),
    ),
    Paper(
        "B. N. J. Persson, Theory of rubber friction and contact mechanics, J. Chem. Phys. 115, "
        "3840 (2001).",
        "10.1063/1.1388626",
        methods=("persson",),
        mentions=("J. Chem. Phys. 115",),
    ),
    Paper(
        "B. N. J. Persson, Elastoplastic contact between randomly rough surfaces, Phys. Rev. Lett. "
        "87, 116101 (2001).",
        "10.1103/PhysRevLett.87.116101",
        methods=("persson",),
    ),
    Paper(
        "C. Yang and B. N. J. Persson, Contact mechanics: contact area and interfacial separation "
        "from small contact to full contact, J. Phys.: Condens. Matter 20, 215214 (2008).",
        "10.1088/0953-8984/20/21/215214",
        methods=("persson",),
    ),
    Paper(
        "A. Wang and M. H. Mueser, Gauging Persson theory on adhesion, Tribol. Lett. 65, 103 "
        "(2017).",
        "10.1007/s11249-017-0886-9",
        mentions=("wang_muser",),
    ),
    Paper(
        "A. Almqvist, F. Sahlin, R. Larsson and S. Glavatskih, On the dry elasto-plastic contact "
        "of nominally flat surfaces, Tribol. Int. 40, 574 (2007).",
        "10.1016/j.triboint.2005.11.008",
        methods=("bem",),
    ),
    Paper(
        "V. A. Yastrebov, G. Anciaux and J.-F. Molinari, On the accurate computation of the true "
        "contact-area in mechanical contact of random rough surfaces, Tribol. Int. 114, 161 "
        "(2017).",
        "10.1016/j.triboint.2017.04.023",
        methods=("bem", "fem"),
    ),
    Paper(
        "M. Hintermueller, K. Ito and K. Kunisch, The primal-dual active set strategy as a "
        "semismooth Newton method, SIAM J. Optim. 13, 865 (2002).",
        "10.1137/S1052623401383558",
        methods=("bem", "fem"),
    ),
    Paper(
        "J. C. Simo and R. L. Taylor, Consistent tangent operators for rate-independent "
        "elastoplasticity, Comput. Methods Appl. Mech. Eng. 48, 101 (1985).",
        "10.1016/0045-7825(85)90070-2",
        mentions=("j2",),
    ),
    Paper(
        "T. Gustafsson and G. D. McBain, scikit-fem: A Python package for finite element "
        "assembly, J. Open Source Softw. 5, 2369 (2020).",
        "10.21105/joss.02369",
        methods=("fem",),
    ),
    Paper(
        "H. M. Westergaard, Bearing pressures and cracks, J. Appl. Mech. 6, A49 (1939).",
        "10.1115/1.4008919",
        mentions=("Westergaard",),
    ),
    Paper(
        "K. L. Johnson, J. A. Greenwood and J. G. Higginson, The contact of elastic regular wavy "
        "surfaces, Int. J. Mech. Sci. 27, 383 (1985).",
        "10.1016/0020-7403(85)90029-3",
        mentions=("Johnson, Greenwood and Higginson",),
    ),
    Paper(
        "K. L. Johnson, The adhesion of two elastic bodies with slightly wavy surfaces, Int. J. "
        "Solids Struct. 32, 423 (1995).",
        "10.1016/0020-7683(94)00111-9",
        mentions=("Int. J. Solids Struct. 32",),
    ),
    Paper(
        "K. L. Johnson, Contact Mechanics, Cambridge University Press (1985).",
        "10.1017/CBO9781139171731",
        mentions=("Johnson, Contact Mechanics",),
    ),
    Paper(
        "D. S. Dugdale, Yielding of steel sheets containing slits, J. Mech. Phys. Solids 8, 100 "
        "(1960).",
        "10.1016/0022-5096(60)90013-2",
        mentions=("Dugdale",),
    ),
    Paper(
        "E. J. Abbott and F. A. Firestone, Specifying surface quality, Mech. Eng. 55, 569 (1933).",
        mentions=("Abbott and Firestone",),
    ),
    Paper(
        "Student, The probable error of a mean, Biometrika 6, 1 (1908).",
        "10.1093/biomet/6.1.1",
        methods=("judge",),
    ),
    Paper(
        "M. H. Mueser and W. B. Dapp, The contact mechanics challenge: Problem definition (2015).",
        "10.48550/arXiv.1512.02403",
        mentions=("The contact mechanics challenge",),
    ),
    Paper(
        "A. Pradhan et al., The surface-topography challenge: a multi-laboratory benchmark study "
        "to advance the characterization of topography, Tribol. Lett. 73 (2025).",
        "10.1007/s11249-025-02014-y",
        mentions=("Pradhan et al.",),
    ),
)

#: The papers that the authors of the libraries ask to be cited.
SOFTWARE = {
    "numpy": "10.1038/s41586-020-2649-2",
    "scipy": "10.1038/s41592-019-0686-2",
    "numba": "10.1145/2833157.2833162",
    "scikit-fem": "10.21105/joss.02369",
}


def sources_of(case: Case) -> list[str]:
    """Return the sources that a case, its gates and their closed forms name, each once."""
    forms = [CLOSED_FORMS[str(g.against)] for g in case.gates if str(g.against) in CLOSED_FORMS]
    named = [case.source, *(gate.source for gate in case.gates), *(form.source for form in forms)]
    return list(dict.fromkeys(source for source in named if source))


def papers_of(case: Case) -> list[Paper]:
    """Return the papers that a case rests on.

    Example:
        >>> from epcontact.harness.case_files.case import load_case
        >>> [paper.doi for paper in papers_of(load_case("hertz-sphere"))][-1]
        '10.1017/CBO9781139171731'
    """
    values = [str(value) for options in case.options.values() for value in options.values()]
    text = "\n".join([*sources_of(case), *values])
    return [
        paper
        for paper in PAPERS
        if set(paper.methods) & set(case.methods) or any(words in text for words in paper.mentions)
    ]


def citation(case: Case) -> Iterator[str]:
    """Yield the lines that tell what a case's results rest on: sources, papers and software."""
    yield f"{case.id}: {case.requirement}"
    yield "\nSources that the case names:"
    yield from (f"  {source}" for source in sources_of(case))
    yield "\nPapers:"
    yield from (f"  {paper}" for paper in papers_of(case))
    yield "\nSoftware, as installed here (a result's own versions are in its JSON file):"
    for name, version in package_versions().items():
        yield f"  {name} {version}" + (f" {_RESOLVER}{SOFTWARE[name]}" if name in SOFTWARE else "")
