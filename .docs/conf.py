"""The guide: Sphinx reads the pages beside this file, the case files and the
docstrings.

    sphinx-build --fail-on-warning -b html .docs site

Each case gets a page, made from its file.  The environment variable EPCONTACT_RESULTS
names an output folder of `epcontact verify --report`, whose charts and report then are
a part of the guide.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from jinja2 import Environment, FileSystemLoader, StrictUndefined

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # the guide is that of this checkout

from epcontact.harness.case_files.case import CaseText, find_cases, load_case  # noqa: E402
from epcontact.harness.case_files.citations import papers_of, sources_of  # noqa: E402
from epcontact.harness.case_files.mistakes import key_table  # noqa: E402
from epcontact.harness.methods.registry import METHODS  # noqa: E402
from epcontact.harness.quantities.registry import QUANTITIES  # noqa: E402
from epcontact.output.charts.figures import Chart  # noqa: E402
from epcontact.reference import CLOSED_FORMS  # noqa: E402
from epcontact.results import package_versions  # noqa: E402
from epcontact.studies import conductance  # noqa: E402

project = "epcontact"
author = "The epcontact developers"
version = release = package_versions()["epcontact"]
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["templates"]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_use_ivar = True
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"epcontact {version}"

_RESULTS = os.environ.get("EPCONTACT_RESULTS", "")
if _RESULTS and (report := Path(_RESULTS).resolve() / "report.html").is_file():
    html_extra_path = [str(report)]


def _charts(case: str, size: str) -> list[tuple[str, str]]:
    """Copy a case's charts into the guide; return the name and the caption of each."""
    folder = Path(_RESULTS).resolve() / case / size
    found = []
    for picture in sorted(folder.glob("*.svg")) if _RESULTS else ():
        caption = picture.with_suffix(".txt")
        copied = HERE / "generated" / f"{case}-{picture.name}"
        copied.write_bytes(picture.read_bytes())
        found.append(
            (copied.name, caption.read_text().strip() if caption.is_file() else "")
        )
    return found


def _case_page(text: CaseText) -> dict[str, Any]:
    size = text.sizes[0]
    case = load_case(text, size)
    return {
        "case": case,
        "sizes": text.sizes,
        "file": text.path.name,
        "toml": text.path.read_text(),
        "sources": sources_of(case),
        "papers": papers_of(case),
        "charts": _charts(case.id, size),
    }


def _cell(words: object) -> str:
    """Return text as a cell of a table, in which no character has a meaning of its
    own.
    """
    escaped = "".join(
        f"\\{c}" if c in r"\`*_{}[]<>()#+-.!|$~^" else c for c in str(words)
    )
    return " ".join(escaped.split())


def _generate(app: Any) -> None:
    """Write the pages of the cases, the tables of the registries, and the map of the
    laws.
    """
    del app
    folder = HERE / "generated"
    folder.mkdir(exist_ok=True)
    pages = Environment(
        loader=FileSystemLoader(HERE / "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # this is Markdown, which the filter `cell` escapes
    )
    pages.filters["cell"] = _cell
    cases = [_case_page(text) for text in find_cases()]
    for page in cases:
        written = pages.get_template("case.md.jinja").render(page)
        (folder / f"{page['case'].id}.md").write_text(written)
    written = pages.get_template("gallery.md.jinja").render(cases=cases)
    (folder / "index.md").write_text(written)
    registries = {
        "methods": METHODS.values(),
        "quantities": QUANTITIES.values(),
        "forms": CLOSED_FORMS.values(),
        "keys": key_table(),
    }
    written = pages.get_template("registries.md.jinja").render(registries)
    (folder / "registries.md").write_text(written)
    laws = conductance.ratios(conductance.table_of_package().query("breadth == 8"))
    table = laws.rename(columns={"law": "series"})
    Chart(conductance.law_map(table), list(table), table.to_numpy().tolist(), "").save(
        folder / "conductance"
    )


def _as_written(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Show modules' docstrings letter by letter (they have columns), and |q| elsewhere
    as it is.
    """
    del app, name, obj, options
    if what == "module":
        lines[:] = ["::", "", *(f"    {line}" for line in lines), ""]
    else:
        lines[:] = [re.sub(r"\|(\w+)\|", r"\|\1\|", line) for line in lines]


def _visit_inline_math(writer: Any, node: nodes.math) -> None:
    """Write an inline formula as MathML, which browsers show without a script."""
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _visit_math_block(writer: Any, node: nodes.math_block) -> None:
    """Write a displayed formula as MathML in a box that scrolls if it is too wide."""
    formula = tex2mathml(node.astext(), as_block=True)
    writer.body.append(f'<div class="math" style="overflow-x: auto">{formula}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Make the generated pages before Sphinx looks for its sources.

    Formulas are MathML, because the scripts that draw them otherwise come from the
    network.
    """
    inline, block = (_visit_inline_math, None), (_visit_math_block, None)
    app.add_html_math_renderer("mathml", inline, block)
    app.connect("builder-inited", _generate)
    app.connect("autodoc-process-docstring", _as_written, priority=900)
