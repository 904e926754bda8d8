"""The cores and the memory of this process, and its compiled kernels: their folder and their time.

Numba keeps compiled code beside its source or in the user's cache.  If it can write to neither, it
refuses to define the function, for example when an administrator installed the package and a
service without a home runs it.  A private folder then replaces them; it is removed with the process
that made it.

A kernel is compiled when it is first called on a machine.  A line in the log says so, and
`compile_seconds` lets costs and time limits leave it out.  Two dangers are kept away:

* Numba writes the index of a kernel's files, and then the file, without a look at what another
  process writes at the same time.  If two processes compile a kernel for different types, a third
  one may then load the code for the wrong types.  So one process at a time compiles a kernel, and
  the others wait and load it.
* LLVM calls Python when it has compiled or loaded a kernel.  Python drops an exception that a
  signal's handler raises there, and the kernel is lost.  So a handler asks `compiling` first.
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
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import psutil

try:
    import fcntl
except ImportError:  # Windows, where numba refuses to replace a file that another process reads
    fcntl = None  # type: ignore[assignment]

_OBJECTS = 100_000  # made between two searches for cycles while a kernel compiles
_CACHE_VARIABLE = "NUMBA_CACHE_DIR"
_PACKAGES = ("epcontact", "fem_check")  # whose kernels compile in turns; a user's are left to numba


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
    """Return True if a process of this machine runs; a dead one whose parent has not asked, not."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


@contextlib.contextmanager
def signals_wait() -> Iterator[None]:
    """Let the handlers of signals that come within the block run at its end.

    It is for a block of C++ that calls Python: an exception that a handler raises there is lost.
    """
    came: dict[int, None] = {}
    handlers: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():  # no other one runs handlers
            for number in signal.valid_signals():
                if callable(handler := signal.getsignal(number)):
                    handlers[number] = handler
                    signal.signal(number, lambda this, _: came.setdefault(this))
        yield
    finally:
        for handled, handler in handlers.items():
            signal.signal(handled, handler)
        for late in came:
            signal.raise_signal(late)


def compile_seconds() -> float:
    """Return the seconds that this process has spent on compiling kernels so far.

    A compilation that is still running counts, and so does waiting for another process that
    compiles the same kernel.  The time to load compiled kernels does not.
    """
    return float(_compilation().seconds()) if "numba" in sys.modules else 0.0


def compiling() -> bool:
    """Return True if this thread is compiling or loading a kernel.

    The handler of a signal must not raise an exception then, but be called again later.
    """
    lock = getattr(sys.modules.get("numba.core.compiler_lock"), "global_compiler_lock", None)
    return lock is not None and bool(lock.is_locked())


@functools.cache
def _compilation() -> Any:
    """Return the listener that times this process's compilations, and says that there are any."""
    from numba.core import event  # most commands solve nothing, and it takes half a second to load

    class Compilation(event.Listener):  # type: ignore[misc]
        """Adds up the outermost compilations; numba runs one at a time."""

        def __init__(self) -> None:
            self._depth, self._started, self._total = 0, 0.0, 0.0
            self._thresholds = gc.get_threshold()

        def on_start(self, _: Any) -> None:
            if not self._depth:
                self._started = time.perf_counter()
                # A compiler makes so many objects that to look for cycles takes a seventh of it.
                self._thresholds = gc.get_threshold()
                gc.set_threshold(max(_OBJECTS, self._thresholds[0]), *self._thresholds[1:])
                if not self._total:
                    logging.getLogger("epcontact").warning(
                        "epcontact compiles kernels that this machine has not used before; "
                        "the time for it counts neither as cost nor against a time limit"
                    )
            self._depth += 1

        def on_end(self, _: Any) -> None:
            self._depth -= 1
            if not self._depth:
                gc.set_threshold(*self._thresholds)
                self._total += time.perf_counter() - self._started

        def seconds(self) -> float:
            running = time.perf_counter() - self._started if self._depth else 0.0
            return self._total + running

    listener = Compilation()
    event.register("numba:compile", listener)
    return listener


_COMPILES = ContextVar("_COMPILES", default=True)


@contextlib.contextmanager
def kept_kernels_only() -> Iterator[None]:
    """Raise LookupError where a kernel would have to be compiled, as far as kernels are ours."""
    before = _COMPILES.set(False)
    try:
        yield
    finally:
        _COMPILES.reset(before)


def provide_kernel_cache() -> None:
    """Set a folder for numba's compiled kernels if numba could write to none of its own.

    Child processes inherit it.  Call this before kernels are defined: from then on their
    compilation is timed.
    """
    _compilation()
    _compile_in_turns()
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


@functools.cache
def _compile_in_turns() -> None:
    """Let one process at a time compile and save a kernel, while others wait and then load it.

    Numba has no setting for this, so the class of its caches is replaced for our own kernels.  It
    also loads a kernel without all that a compilation needs, such as scipy's linear algebra, which
    takes longer than to load the kernels of a solve.  A numba that lacks the private names that
    this rests on keeps its own caches.
    """
    from numba.core import caching, dispatcher, event
    from numba.core.runtime import rtsys

    mine = threading.local()  # the caches of which a thread holds locks

    class Leaving(event.Listener):  # type: ignore[misc]
        """Gives back the locks of kernels that could not be compiled."""

        def on_start(self, _: Any) -> None:
            pass

        def on_end(self, _: Any) -> None:
            while not compiling() and getattr(mine, "caches", []):
                mine.caches[-1].let_others()

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        """Holds a lock from the moment when a kernel is missing until it is saved."""

        def __init__(self, function: Any) -> None:
            super().__init__(function)
            self._held: contextlib.ExitStack | None = None
            self._lock_path = f"{self.cache_path}/{self._impl.filename_base}.lock"
            self._load, self._guarded = self._load_overload, self._guard_against_spurious_io_errors
            # Numba watches the file of a kernel, but not those of the kernels that it calls.
            self._cache_file._source_stamp = _stamp(Path(function.__code__.co_filename).parent)

        def load_overload(self, signature: Any, context: Any) -> Any:
            with self._locked("LOCK_SH"):
                found = self._saved(signature, context)
            if found is None and not _COMPILES.get():
                raise LookupError(f"{self} holds no kernel for {signature}")
            if found is None and self._held is None:
                self._held = self._locked("LOCK_EX")
                mine.caches = [*getattr(mine, "caches", []), self]
                found = self._saved(signature, context)
                if found is not None:
                    self.let_others()
            return found

        def _saved(self, signature: Any, context: Any) -> Any:
            """As numba's load_overload, but without the refresh of the context before it."""
            rtsys.initialize(context)
            with self._guarded():
                return self._load(signature, context)

        def save_overload(self, signature: Any, data: Any) -> None:
            try:
                super().save_overload(signature, data)
            finally:
                self.let_others()

        def let_others(self) -> None:
            """Give the lock back, if it is held."""
            if self._held is not None:
                self._held.close()
                self._held = None
                mine.caches.remove(self)

        def _locked(self, kind: str) -> contextlib.ExitStack:
            """A lock, which its closing gives back; none where the system has none."""
            lock = contextlib.ExitStack()
            with contextlib.suppress(OSError):
                if fcntl is not None:
                    file = lock.enter_context(open(self._lock_path, "ab"))  # noqa: SIM115
                    try:
                        fcntl.flock(file, getattr(fcntl, kind) | fcntl.LOCK_NB)
                    except BlockingIOError:
                        with event.trigger_event("numba:compile"):  # by another process
                            fcntl.flock(file, getattr(fcntl, kind))
            return lock

    def cache_of(function: Any) -> Any:
        if function.__module__.partition(".")[0] in _PACKAGES:
            with contextlib.suppress(AttributeError):
                return Cache(function)
        return caching.FunctionCache(function)

    event.register("numba:compiler_lock", Leaving())
    dispatcher.FunctionCache = cache_of  # type: ignore[attr-defined]


@functools.cache
def _stamp(folder: Path) -> bytes:
    """Return the digest of the sources in a folder."""
    sources = (path.read_bytes() for path in sorted(folder.glob("*.py")))
    return hashlib.sha256(b"".join(sources)).digest()


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
