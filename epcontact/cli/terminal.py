"""Tables and sentences on a terminal of any width, and in a pipe.

All words that are printed pass through `text_of`.  Words from a file can therefore
neither style the output nor send commands to the terminal.  Single lines are printed by
`print_text` and `print_error` of `main`, which do the same without loading rich.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

from epcontact.cli.ascii_forms import encodable
from epcontact.errors import without_controls

#: The fewest columns of a terminal at which rows with long texts are a table.
WIDE = 150
#: The fewest columns at which other rows are a table.
NARROW = 75
#: Columns between two columns of a table.
_GAP = 2
#: Columns of a pipe or file, which has no width of its own.
_PIPE = 200


def text_of(words: object, style: str = "") -> Text:
    """Return words as a text for a console or a cell of a table.

    The words have no markup, and control characters in them are shown as escapes.

    Args:
        words: What is printed; anything but a string is converted by `str`.
        style: Style of the whole text in the terms of rich, such as "bold red".
    """
    # Here, and not only when the stream is written, because "+-" is wider than "±".
    encoding = getattr(sys.stdout, "encoding", None)
    return Text(encodable(without_controls(str(words)), encoding), style)


def open_console(pipe: int = _PIPE) -> Console:
    """Return the console of standard output; in a pipe it has `pipe` columns."""
    console = Console()
    if console.is_terminal:
        return console
    return Console(width=pipe)


class WordsTable(Table):
    """A table whose cells are words, not markup, and that breaks no word or number.

    Where its columns need more room than there is, `narrower` is printed in its place.

    Attributes:
        narrower: Another table of the same content; None: a list of the cells.
        is_list: Whether this table is such a list, which breaks words if it must.
    """

    narrower: Table | None = None
    is_list = False

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        """Add a row; strings become cells by `text_of`.

        Args:
            cells: The cells; what is no string is added unchanged.
            options: See `rich.table.Table.add_row`.
        """
        texts = [text_of(cell) if isinstance(cell, str) else cell for cell in cells]
        super().add_row(*texts, **options)

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> RenderResult:
        """Yield the lines of this table, or those of the narrower one."""
        if self._fits(console, options) or self.is_list:
            yield from super().__rich_console__(console, options)
        else:
            yield self.narrower or as_list(self)

    def _fits(self, console: Console, options: ConsoleOptions) -> bool:
        """Set the widths of the columns, the widest of which are narrowed to fit.

        Returns:
            Whether every word has room; if not, the widths are left to rich.
        """
        least = []
        widths = []
        for column in self.columns:
            column.width = None
            cells = [column.header, *column.cells]
            sizes = [Measurement.get(console, options, cell) for cell in cells]
            width = max(size.maximum for size in sizes)
            longest_word = max(size.minimum for size in sizes)
            if column.no_wrap:
                longest_word = width
            if column.max_width is not None:  # what is longer may be cut off
                width = min(width, column.max_width)
                longest_word = 0
            least.append(longest_word)
            widths.append(width)
        room = options.max_width - _GAP * (len(widths) - 1)
        if sum(least) > room:
            return False
        while sum(widths) > room:
            spare = [a if a > b else 0 for a, b in zip(widths, least, strict=True)]
            widths[spare.index(max(spare))] -= 1
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        return True


def new_table(texts: Sequence[str], numbers: Sequence[str] = ()) -> WordsTable:
    """Return an empty table without lines.

    Args:
        texts: Headings of columns that are aligned left.
        numbers: Headings of the columns after them, which are aligned right.
    """
    columns = [Column(text_of(h), overflow="fold", justify="left") for h in texts]
    for heading in numbers:
        columns.append(Column(text_of(heading), overflow="fold", justify="right"))
    return WordsTable(*columns, box=None, pad_edge=False)


def fit_table(table: Table, width: int, fewest: int = NARROW) -> Table:
    """Return a table, or on a narrow terminal a list of its cells.

    Args:
        table: The table.
        width: Columns of the terminal.
        fewest: Columns of the terminal below which the cells are a list.
    """
    if width >= fewest:
        return table
    return as_list(table)


def as_list(table: Table) -> Table:
    """Return a list of the cells of a table.

    Each cell that is not empty becomes a line with its heading, and a row of one cell
    becomes a title.
    """
    lines = new_table(("", ""))
    lines.show_header = False
    lines.is_list = True
    headings = [column.header for column in table.columns]
    for row in zip(*(column.cells for column in table.columns), strict=True):
        filled = []
        for heading, cell in zip(headings, row, strict=True):
            if str(cell) != "":
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
            table.add_row(*row)
        console.print(table)
        return
    for first, *middle, last in rows:
        cells = []
        for heading, text in zip(headings[1:], middle, strict=False):
            if text:
                cells.append(f"{heading} {text}" if named else text)
        console.print(text_of(first, "bold"), text_of("  ".join(cells)))
        if last:
            console.print(Padding(text_of(last), (0, 0, 0, 2)))


def print_sentence(console: Console, sentence: str) -> None:
    """Print a sentence on a console.

    On a terminal the lines are broken between words, and all but the first are
    indented; in a pipe the sentence is one line.
    """
    width = 2 * len(sentence)
    if console.is_terminal:
        width = console.width - 2
    indent = Text("")
    for line in text_of(sentence).wrap(console, width):
        console.print(indent + line, soft_wrap=True)
        indent = Text("  ")
