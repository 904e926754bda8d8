"""The progress of a verification in a notebook."""

from __future__ import annotations

import html
import sys

from epcontact.harness.solving.tasks import Progress


def notebook_progress() -> Progress | None:
    """Show a bar of progress in the running notebook.

    Returns:
        The function that moves the bar, see `Progress`; None outside of a notebook.
    """
    # A notebook has imported IPython, which is no dependency of this package.
    ipython = sys.modules.get("IPython")
    shell = getattr(ipython, "get_ipython", lambda: None)()
    if ipython is None or type(shell).__name__ != "ZMQInteractiveShell":
        return None
    display = ipython.display
    handle = display.display(display.HTML("solving"), display_id=True)

    last = ""

    def report(done: float, total: int, words: str) -> None:
        """Show that so many of all solves are done, and the last that was finished."""
        nonlocal last
        last = words or last
        bar = f'<progress value="{done:g}" max="{total}"></progress>'
        text = html.escape(f"{int(done)} of {total} solves: {last}")
        handle.update(display.HTML(f"{bar} {text}"))

    return report
