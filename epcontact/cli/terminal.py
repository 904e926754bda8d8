"""Tables and sentences on a terminal of any width, and in a pipe."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

#: The fewest columns of a terminal at which rows with long texts are a table.
WIDE = 150
#: The fewest columns at which other rows are a table.
NARROW = 75
#: Columns of a pipe or file, which has no width of its own.
_PIPE = 200


def open_console() -> Console:
    """Return the console of standard output; in a pipe it has `_PIPE` columns."""
    console = Console()
    if console.is_terminal:
        return console
    return Console(width=_PIPE)


def new_table(texts: Sequence[str], numbers: Sequence[str] = ()) -> Table:
    """Return an empty table without lines.

    Args:
        texts: Headings of columns that are aligned left.
        numbers: Headings of the columns after them, which are aligned right.
    """
    columns = [Column(heading, overflow="fold", justify="left") for heading in texts]
    for heading in numbers:
        columns.append(Column(heading, overflow="fold", justify="right"))
    return Table(*columns, box=None, pad_edge=False)


def fit_table(table: Table, width: int, fewest: int = NARROW) -> Table:
    """Return a table, or on a narrow terminal a list of its cells.

    Args:
        table: The table.
        width: Columns of the terminal.
        fewest: If the terminal has fewer columns, each cell that is not empty becomes a
            line with its heading; a row of one cell becomes a title.
    """
    if width >= fewest:
        return table
    lines = new_table(("", ""))
    lines.show_header = False
    headings = [column.header for column in table.columns]
    for row in zip(*(column.cells for column in table.columns), strict=True):
        filled = []
        for heading, cell in zip(headings, row, strict=True):
            if cell != "":
                # A padding is left out.
                filled.append((heading, getattr(cell, "renderable", cell)))
        if len(filled) == 1:
            lines.add_row(filled[0][1])
        else:
            for heading, cell in filled:
                lines.add_row(heading, cell)
    return lines


def print_rows(
    console: Console,
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    named: bool = True,
) -> None:
    """Print rows of texts as a table, or on a narrow terminal as paragraphs.

    Args:
        console: The console.
        headings: Headings of the columns.
        rows: The texts of each row.
        named: Whether the cells of a paragraph have their headings.
    """
    if console.width >= WIDE:
        table = new_table(headings)
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table)
        return
    for first, *middle, last in rows:
        cells = []
        for heading, text in zip(headings[1:], middle, strict=False):
            if text:
                cells.append(f"{heading} {text}" if named else text)
        console.print(Text(first, "bold"), Text("  ".join(cells)))
        if last:
            console.print(Padding(Text(last), (0, 0, 0, 2)))


def print_sentence(console: Console, sentence: str) -> None:
    """Print a sentence on a console.

    On a terminal the lines are broken between words, and all but the first are
    indented; in a pipe the sentence is one line.
    """
    width = 2 * len(sentence)
    if console.is_terminal:
        width = console.width - 2
    indent = Text("")
    for line in Text(sentence).wrap(console, width):
        console.print(indent + line, soft_wrap=True)
        indent = Text("  ")
