"""A bar of progress in a notebook, as long as a solve or a verification lasts."""

from __future__ import annotations

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

#: Called with the fraction that is done, from 0 to 1, and what is being done in words.
OnProgress = Callable[[float, str], None]

#: Seconds before a bar appears, and between two of its movements.
_DELAY, _PAUSE = 1.0, 0.1
#: Whether a bar is shown already: the solves of a verification have none of their own.
_is_shown = ContextVar("_is_shown", default=False)


@contextlib.contextmanager
def notebook_bar(given: OnProgress | None = None) -> Iterator[OnProgress | None]:
    """Return a context manager that shows a bar of progress in the running notebook.

    The bar appears after a second and vanishes at the end.  There is none outside of a
    notebook, none inside of another `notebook_bar`, and none if the caller of the solve
    has given a function that reports the progress.

    Args:
        given: this function; None: there is none.

    Yields:
        The function that moves the bar, or `given`.
    """
    # A notebook has imported IPython, which is no dependency of this package.
    ipython = sys.modules.get("IPython")
    shell = getattr(ipython, "get_ipython", lambda: None)()
    is_notebook = getattr(shell, "kernel", None) is not None
    if given is not None or _is_shown.get() or ipython is None or not is_notebook:
        yield given
        return
    bar = _Bar(ipython.display)
    token = _is_shown.set(True)
    try:
        yield bar.move
    finally:
        _is_shown.reset(token)
        bar.remove()


class _Bar:
    """A bar of progress, drawn by the browser that shows the notebook."""

    def __init__(self, display: Any) -> None:
        """Create a bar that is not shown yet.

        Args:
            display: the module `IPython.display`.
        """
        self._display = display
        self._handle: Any = None
        self._next = time.monotonic() + _DELAY

    def move(self, fraction: float, words: str) -> None:
        """Show that a fraction from 0 to 1 is done, and what is being done in words."""
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + _PAUSE
        text = html.escape(words)
        bar = f'<progress value="{fraction:.3f}" max="1"></progress> {text}'
        content = self._display.HTML(bar)
        if self._handle is None:
            self._handle = self._display.display(content, display_id=True)
        else:
            self._handle.update(content)

    def remove(self) -> None:
        """Remove the bar from the notebook, if it was shown."""
        if self._handle is not None:
            self._handle.update(self._display.HTML(""))
