"""The cores and the memory of this process, and its compiled kernels: their folder and their time.

Numba keeps compiled code beside its source or in the user's cache.  If it can write to neither, it
refuses to define the function, for example when an administrator installed the package and a
service without a home runs it.  A private folder then replaces them; it is removed with the process
that made it.

A kernel is compiled when it is first called on a machine.  A line in the log says so, and
`compile_seconds` lets costs and time limits leave it out.
"""

from __future__ import annotations

import atexit
import functools
import gc
import logging
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

_CACHE_VARIABLE = "NUMBA_CACHE_DIR"


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def available_memory() -> int:
    """Return the bytes of memory that this process may still take."""
    return int(psutil.virtual_memory().available)


def peak_memory() -> int:
    """Return the largest resident memory of this process so far, in bytes."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    import resource  # does not exist on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def compile_seconds() -> float:
    """Return the seconds that this process has spent on compiling kernels so far.

    A compilation that is still running counts.  The time to load compiled kernels does not.
    """
    return float(_compilation().seconds()) if "numba" in sys.modules else 0.0


@functools.cache
def _compilation() -> Any:
    """Return the listener that times this process's compilations, and says that there are any."""
    from numba.core import event  # most commands solve nothing, and it takes half a second to load

    class Compilation(event.Listener):  # type: ignore[misc]
        """Adds up the outermost compilations; numba runs one at a time."""

        def __init__(self) -> None:
            self._depth, self._started, self._total = 0, 0.0, 0.0

        def on_start(self, _: Any) -> None:
            if not self._depth:
                self._started = time.perf_counter()
                if not self._total:
                    logging.getLogger("epcontact").warning(
                        "epcontact compiles its kernels, once on a machine; "
                        "neither costs nor time limits count it"
                    )
            self._depth += 1

        def on_end(self, _: Any) -> None:
            self._depth -= 1
            if not self._depth:
                self._total += time.perf_counter() - self._started

        def seconds(self) -> float:
            running = time.perf_counter() - self._started if self._depth else 0.0
            return self._total + running

    listener = Compilation()
    event.register("numba:compile", listener)
    return listener


def provide_kernel_cache() -> None:
    """Set a folder for numba's compiled kernels if numba could write to none of its own.

    Child processes inherit it.  Call this before kernels are defined: from then on their
    compilation is timed.
    """
    _compilation()
    # At its end the interpreter would look through all objects of the compiler for cycles, which
    # takes as long as many a solve; the system gets their memory back anyway.
    atexit.register(gc.freeze)
    here = Path(__file__).parent
    named = os.environ.get(_CACHE_VARIABLE)
    if named and _writable(Path(named)):
        return
    if all(_writable(p / "__pycache__") for p in (here / "bem", here.parent / "fem_check")):
        return
    # Numba's next choice, see numba.core.caching.
    if _writable(_user_cache()):
        return
    try:
        folder = tempfile.mkdtemp(prefix="epcontact-kernels-")
    except OSError:
        return
    os.environ[_CACHE_VARIABLE] = folder
    if "numba" in sys.modules:
        sys.modules["numba"].config.reload_config()
    atexit.register(_remove, folder, os.getpid())


def _writable(folder: Path) -> bool:
    """Make `folder` if it is missing; return True if files can be made in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _user_cache() -> Path:
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "numba"
    if os.name != "posix":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "numba"


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)
