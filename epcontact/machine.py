"""The cores and the memory of this process, and its compiled kernels: their folder and their time.

Numba keeps compiled code beside its source or in the user's cache.  Where it can write to neither,
it refuses to define a kernel, so a private folder is made, which goes with the process that made
it.  Two dangers are kept away.  Processes that write the files of one kernel at the same time may
leave code for the wrong types there, so one process at a time compiles.  And LLVM calls Python,
which drops an exception that a signal's handler raises there, and the kernel is lost: so a handler
asks `compiling` first.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import hashlib
import logging
import os
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import psutil

try:
    import fcntl
except ImportError:  # Windows, where numba refuses to replace a file that another process reads
    fcntl = None  # type: ignore[assignment]

_OBJECTS = 100_000  # made between two searches for cycles while a kernel compiles
_CACHE_VARIABLE = "NUMBA_CACHE_DIR"
_PACKAGES = ("epcontact", "fem_check")  # whose kernels are watched; a user's are left to numba


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


def alive(pid: int) -> bool:
    """Return True if a process of this machine runs; one that has ended unnoticed does not."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


class _Kernels:
    """What this process does with kernels, and the lock by which one process at a time compiles."""

    def __init__(self) -> None:
        self.depth, self.total, self.started = 0, 0.0, 0.0
        self.lock_path: Path | None = None
        self._mutex, self._lock = threading.RLock(), contextlib.ExitStack()
        self._told, self._missed, self._alone = False, False, True
        self._thresholds = gc.get_threshold()

    def begin(self) -> None:
        """Begin to load or to compile a kernel, in any thread."""
        with self._mutex:
            self.depth += 1
            if self.depth > 1:
                return
            self.started, self._thresholds = time.perf_counter(), gc.get_threshold()
            # A compiler makes so many objects that to look for cycles takes a seventh of its time.
            gc.set_threshold(max(_OBJECTS, self._thresholds[0]), *self._thresholds[1:])
            try:
                self._wait(alone=self._alone)
            except BaseException:  # an interrupt while another process compiles
                self.end()
                raise

    def miss(self) -> None:
        """Compile a kernel that this machine has not kept."""
        if not self._told:
            logging.getLogger("epcontact").warning(
                "epcontact compiles kernels that this machine has not used before; "
                "the time for it counts neither as cost nor against a time limit"
            )
        self._told = self._missed = True
        if not self._alone:
            self._wait(alone=True)

    def end(self) -> None:
        """End what `begin` began."""
        with self._mutex:
            self.depth -= 1
            if not self.depth:
                gc.set_threshold(*self._thresholds)
                self.total += time.perf_counter() - self.started
                # After a missing kernel others are likely to miss: processes share them out.
                self._alone, self._missed = self._missed, False
                self._lock.close()

    def _wait(self, *, alone: bool) -> None:
        """Wait for processes that compile or, `alone`, for all that load kernels, too."""
        self._lock.close()
        with contextlib.suppress(OSError):  # a folder that is only read, or cannot be locked
            if fcntl is not None and self.lock_path is not None:
                file = self._lock.enter_context(self.lock_path.open("ab"))
                fcntl.flock(file, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)


_KERNELS = _Kernels()


def compile_seconds() -> float:
    """Return the seconds that this process has spent on compiling and loading kernels so far.

    What is still running counts, and so does waiting for another process that compiles.
    """
    running = time.perf_counter() - _KERNELS.started if _KERNELS.depth else 0.0
    return _KERNELS.total + running


def compiling() -> bool:
    """Return True if this process is compiling or loading a kernel.

    The handler of a signal must not raise an exception then, but be called again later.
    """
    return _KERNELS.depth > 0


@functools.cache
def provide_kernel_cache() -> None:
    """Watch the compilation of kernels, and set a folder for them if numba could write to none.

    Child processes inherit it.  Call this before kernels are defined.
    """
    from numba.core import event  # most commands solve nothing, and it takes half a second to load

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, happening: Any) -> None:
            if happening.kind == "numba:compile":
                _KERNELS.miss()
            else:
                _KERNELS.begin()

        def on_end(self, happening: Any) -> None:
            if happening.kind != "numba:compile":
                _KERNELS.end()

    event.register("numba:compiler_lock", Listener())
    event.register("numba:compile", Listener())
    _keep_kernels()
    # At its end the interpreter would look through all objects of the compiler for cycles, which
    # takes as long as many a solve; the system gets their memory back anyway.
    atexit.register(gc.freeze)
    with contextlib.suppress(OSError):
        _KERNELS.lock_path = _kernel_folder() / "epcontact.lock"


def _kernel_folder() -> Path:
    """Return the folder where numba will keep kernels, or one of those; a new one if need be."""
    from numba.misc.appdirs import AppDirs

    here = Path(__file__).parent
    named = os.environ.get(_CACHE_VARIABLE)
    beside = [p / "__pycache__" for p in (here / "bem", here.parent / "fem_check")]
    user = Path(AppDirs(appname="numba", appauthor=False).user_cache_dir)
    for folders in ([Path(named)] if named else [], beside, [user]):
        if folders and all(map(_writable, folders)):
            return folders[0]
    folder = tempfile.mkdtemp(prefix="epcontact-kernels-")
    os.environ[_CACHE_VARIABLE] = folder
    sys.modules["numba"].config.reload_config()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _writable(folder: Path) -> bool:
    """Make `folder` if it is missing; return True if files can be made in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _keep_kernels() -> None:
    """Replace numba's class of caches for our kernels, as numba has no settings for this.

    A numba that lacks the private names that this rests on keeps its own caches.
    """
    from numba.core import caching, dispatcher
    from numba.core.runtime import rtsys

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        def __init__(self, function: Any) -> None:
            super().__init__(function)
            # Numba watches the file of a kernel, but not those of the kernels that it calls.
            self._cache_file._source_stamp = _stamp(Path(function.__code__.co_filename).parent)

        def load_overload(self, signature: Any, context: Any) -> Any:
            # Numba would load what only a compilation needs, which takes longer than the kernels.
            context.refresh = functools.partial(rtsys.initialize, context)
            try:
                return super().load_overload(signature, context)
            finally:
                del context.refresh

    def cache_of(function: Any) -> Any:
        if function.__module__.partition(".")[0] in _PACKAGES:
            with contextlib.suppress(AttributeError):
                return Cache(function)
        return caching.FunctionCache(function)

    dispatcher.FunctionCache = cache_of  # type: ignore[attr-defined]


@functools.cache
def _stamp(folder: Path) -> bytes:
    """Return the digest of the sources in a folder."""
    sources = (path.read_bytes() for path in sorted(folder.glob("*.py")))
    return hashlib.sha256(b"".join(sources)).digest()
