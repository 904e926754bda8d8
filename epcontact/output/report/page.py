"""The HTML of a report: pure functions from plain dictionaries to text.

The page is one file that asks no other host for anything, which its content-security policy makes
the browser enforce; it needs no script, follows the reader's choice of light or dark, and fits a
phone: tables scroll within themselves.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from epcontact.results import number_from_json

_KINDS = {"svg": "image/svg+xml", "png": "image/png", "gif": "image/gif"}
_BADGES = {"holds": "good", "falls short": "bad", "error": "bad", "skipped": "idle"}

STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --soft: #5a5a5a; --paper: #ffffff;
  --line: #d8d8d8; --tint: #f5f5f5; --good: #00694e; --bad: #a63c00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --soft: #ababab; --paper: #161616;
  --line: #3c3c3c; --tint: #212121; --good: #4fc9a2; --bad: #ff9a5c; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 68rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.25rem; margin-top: 2.5rem;
  border-top: 1px solid var(--line); padding-top: 1rem; } h3 { font-size: 1rem; }
a { color: inherit; } .soft { color: var(--soft); }
.badge { border: 1px solid currentColor; border-radius: 0.3rem; padding: 0 0.4rem;
  font-size: 0.85em; white-space: nowrap; }
.good { color: var(--good); } .bad { color: var(--bad); font-weight: 600; }
.idle { color: var(--soft); }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: 0.875rem;
  font-variant-numeric: tabular-nums; min-width: 100%; }
th, td { text-align: left; vertical-align: top; padding: 0.3rem 0.7rem 0.3rem 0;
  border-bottom: 1px solid var(--line); } th { color: var(--soft); font-weight: 600; }
tr.noted td { border-bottom: 0; padding-bottom: 0; }
tr.note td { color: var(--soft); padding-top: 0; }
tr.note p { margin: 0 0 0.2rem; max-width: 46rem; }
td.n, th.n { text-align: right; white-space: nowrap; }
figure { margin: 1rem 0; } figure img { display: block; max-width: 100%; height: auto;
  background: #ffffff; border-radius: 0.3rem; }
figcaption { font-size: 0.875rem; color: var(--soft); max-width: 46rem; }
.figures { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 28rem), 1fr)); }
details { background: var(--tint); border-radius: 0.3rem; padding: 0.4rem 0.8rem;
  margin: 0.8rem 0; } td.long { min-width: 16rem; }
summary { cursor: pointer; } code { font-size: 0.85em; overflow-wrap: anywhere; }
"""


@dataclass(frozen=True)
class Picture:
    """A picture to be put into the page whole: its bytes, "svg", "png" or "gif", its caption."""

    content: bytes
    kind: str
    caption: str


@dataclass(frozen=True)
class Cell:
    """A table cell: its text, a class, and whether it stands to the right as numbers do."""

    text: str
    badge: str = ""
    number: bool = False


def document(title: str, body: Sequence[str]) -> str:
    """The whole page."""
    return "\n".join(
        [
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
            "img-src data:; style-src 'unsafe-inline'\">",
            f'<title>{text(title)}</title>\n<link rel="icon" href="data:,">',
            f"<style>{STYLE}</style>\n</head>\n<body>",
            *body,
            "</body>\n</html>\n",
        ]
    )


def text(value: object) -> str:
    """Any value as text that cannot be taken for HTML."""
    return html.escape(str(value))


def badge(status: str) -> str:
    """A status in its colour, and in words."""
    return f'<span class="badge {_BADGES.get(status, "idle")}">{text(status)}</span>'


def table(
    headings: Sequence[str | Cell],
    rows: Sequence[Sequence[str | Cell]],
    notes: Sequence[str] = (),
) -> str:
    """A table that scrolls within itself where it is too wide; notes stand under their rows."""
    head = "".join(_cell(h, "th") for h in headings)
    lines = ["<tr>" + "".join(_cell(c, "td") for c in row) + "</tr>" for row in rows]
    if notes:
        under = f'<tr class=note><td colspan="{len(headings)}"><p>{{}}</p></td></tr>'
        lines = [a + under.format(text(n)) for a, n in zip(lines, notes, strict=True)]
        lines = [line.replace("<tr>", "<tr class=noted>", 1) for line in lines]
    body = "".join(lines)
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def figure(picture: Picture) -> str:
    """A picture with its caption, its data in the page."""
    data = base64.b64encode(picture.content).decode()
    return (
        f'<figure><img alt="{text(picture.caption)}" '
        f'src="data:{_KINDS[picture.kind]};base64,{data}">'
        f"<figcaption>{text(picture.caption)}</figcaption></figure>"
    )


def number(value: Any, digits: int = 4) -> Cell:
    """A number as a cell; what is no number as it stands; an empty cell for None."""
    if value is None:
        return Cell("", number=True)
    try:
        found = number_from_json(value)
    except (TypeError, ValueError):
        return Cell(str(value))
    if math.isnan(found):
        return Cell("–", number=True)
    return Cell(f"{found:.{digits}g}", number=True)


def with_interval(mean: Any, half_width: Any, digits: int = 4) -> Cell:
    """A mean and the half-width of its interval; the mean alone where there is none."""
    shown = number(mean, digits).text
    half = number_from_json(half_width if half_width is not None else 0.0)
    return Cell(f"{shown} ± {half:.2g}" if half > 0 else shown, number=True)


def size_of(count: Any) -> str:
    """A number of bytes in words."""
    return f"{number_from_json(count) / 2**20:,.0f} MiB"


def plain_list(values: Mapping[str, Any]) -> str:
    """Names and values in one line."""
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _cell(value: str | Cell, tag: str) -> str:
    cell = value if isinstance(value, Cell) else Cell(value)
    inner = badge(cell.text) if cell.badge else text(cell.text)
    return f"<{tag}{' class=n' if cell.number else ''}>{inner}</{tag}>"
