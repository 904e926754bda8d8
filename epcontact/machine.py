"""The cores and the memory of this process, and its compiled kernels: their folder and
their time.

Numba keeps compiled code beside its source or in the user's cache.  Where it can write
to neither, it refuses to define a kernel, so a private folder is made, which goes with
the process that made it.  Two dangers are kept away: processes that write the files of
one kernel at the same time may leave code for the wrong types, so one at a time
compiles; and LLVM calls Python, which drops an exception that a signal's handler raises
there, so a handler asks `compiling` first.
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
from pathlib import Path
from typing import Any

import psutil

try:
    import fcntl
except (
    ImportError
):  # Windows, where numba refuses to replace a file that another process reads
    fcntl = None  # type: ignore[assignment]

_OBJECTS = 100_000  # made between two searches for cycles while a kernel compiles
#: numpy starts the threads of its linear algebra when it is imported, unless it may
#: have only one.
LINEAR_ALGEBRA = "OPENBLAS_NUM_THREADS"
#: ducc0 starts its threads when it first transforms, unless it may have only one.
TRANSFORMS = "DUCC0_NUM_THREADS"
for _name in (TRANSFORMS, "OMP_NUM_THREADS"):  # ducc0 would fail on what is no number
    if not os.environ.get(_name, "0").strip().isdecimal():
        del os.environ[_name]
_PACKAGES = (
    "epcontact",
    "fem_check",
)  # whose kernels are watched; a user's are left to numba


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def available_memory() -> int:
    """Return the bytes of memory that this process may still take."""
    return int(psutil.virtual_memory().available)


def forget_peak() -> None:
    """Let the peak of the memory begin anew for the next solve, which only Linux
    can.
    """
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory() -> int:
    """Return the largest resident memory (bytes) since `forget_peak`, or the process
    began.
    """
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    with contextlib.suppress(OSError, StopIteration):
        lines = (
            Path("/proc/self/status")
            .read_text(encoding="ascii", errors="replace")
            .splitlines()
        )
        return 1024 * int(
            next(line.split()[1] for line in lines if line.startswith("VmHWM:"))
        )
    import resource  # does not exist on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def alive(pid: int) -> bool:
    """Return True if a process of this machine runs; one that has ended unnoticed does
    not.
    """
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def describe_death(code: int | None) -> str:
    """Describe how a process ended.

    Args:
        code: its exit code; -n for the signal n, None if it was ended from here.
    """
    if code is None:
        return "was ended"
    if code >= 0:
        return f"ended with exit code {code}"
    names = {each.value: each.name for each in signal.Signals}
    name = names.get(-code, f"signal {-code}")
    causes = {
        "SIGKILL": " (most likely for want of memory)",
        "SIGSEGV": " (invalid memory access)",
    }
    return f"was killed by {name}{causes.get(name, '')}"


@contextlib.contextmanager
def single_threads(*names: str) -> Iterator[None]:
    """Set variables of the environment to one thread, and then back to what they
    were.
    """
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            del os.environ[name]
            os.environ.update({} if value is None else {name: value})


class _Kernels:
    """The kernels of this process, and the lock by which one process at a time
    compiles.
    """

    def __init__(self) -> None:
        self.depth, self.total, self.started = 0, 0.0, 0.0
        self.lock_path: Path | None = None
        self._mutex, self._lock = threading.RLock(), contextlib.ExitStack()
        self._told, self._missed, self._alone = False, False, True
        self._thresholds = gc.get_threshold()

    def notify(self, event: Any) -> None:
        """Hear from numba that any thread begins or ends to work on a kernel, or to
        compile it.
        """
        if event.kind == "numba:compiler_lock":
            with self._mutex:
                self._begin() if event.is_start else self._end()
        elif event.is_start:
            if not self._told:
                logging.getLogger("epcontact").warning(
                    "epcontact compiles kernels that this machine has not used before; "
                    "the time for it counts neither as cost nor against a time limit"
                )
            self._told = self._missed = True
            if not self._alone:
                self._wait(alone=True)

    def _begin(self) -> None:
        """Note the beginning of a compilation."""
        self.depth += 1
        if self.depth > 1:
            return
        self.started, self._thresholds = time.perf_counter(), gc.get_threshold()
        # A compiler makes so many objects that to look for cycles takes a seventh of
        # its time.
        gc.set_threshold(max(_OBJECTS, self._thresholds[0]), *self._thresholds[1:])
        try:
            self._wait(alone=self._alone)
        except BaseException:  # an interrupt while another process compiles
            self._end()
            raise

    def _end(self) -> None:
        """Note the end of a compilation and count its time."""
        self.depth -= 1
        if not self.depth:
            gc.set_threshold(*self._thresholds)
            self.total += time.perf_counter() - self.started
            # After a kernel that was missing others will be missing: processes share
            # them out.
            self._alone, self._missed = self._missed, False
            self._lock.close()

    def _wait(self, *, alone: bool) -> None:
        """Wait for processes that compile or, `alone`, for all that load kernels,
        too.
        """
        self._lock.close()
        with contextlib.suppress(
            OSError
        ):  # a folder that is only read, or cannot be locked
            if fcntl is not None and self.lock_path is not None:
                file = self._lock.enter_context(self.lock_path.open("ab"))
                fcntl.flock(file, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)


_KERNELS = _Kernels()


def compile_seconds() -> float:
    """Return the seconds that this process has spent on compiling and loading kernels
    so far.  What is still running counts, and so does waiting for another process that
    compiles.
    """
    running = time.perf_counter() - _KERNELS.started if _KERNELS.depth else 0.0
    return _KERNELS.total + running


def compiling() -> bool:
    """Return True if this process is compiling or loading a kernel.  The handler of a
    signal must not raise an exception then, but be called again later.
    """
    return _KERNELS.depth > 0


@functools.cache
def provide_kernel_cache() -> None:
    """Watch how numba compiles and keeps our kernels.  Call this before they are
    defined.  Numba has no settings for this, so its class of caches is replaced for our
    own kernels.
    """
    # Most commands solve nothing, and numba takes half a second to load.
    from numba.core import caching, config, dispatcher, event
    from numba.core.runtime import rtsys

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        def __init__(self, function: Any) -> None:
            try:
                super().__init__(function)
            except RuntimeError:  # numba can write to none of the folders that it tries
                private = tempfile.mkdtemp(prefix="epcontact-kernels-")
                atexit.register(shutil.rmtree, private, ignore_errors=True)
                os.environ["NUMBA_CACHE_DIR"] = private  # child processes inherit it
                config.reload_config()
                super().__init__(function)
            source, kept = (
                Path(function.__code__.co_filename).parent,
                Path(self.cache_path),
            )
            # Numba watches the file of a kernel, but not those of the kernels that it
            # calls.
            with contextlib.suppress(AttributeError):  # a private name
                self._cache_file._source_stamp = _stamp(source)
            # Beside the sources every folder has its own kernels, elsewhere there is
            # one for all.
            home = (
                Path(__file__).parent / "__pycache__"
                if kept.parent == source
                else kept.parent
            )
            with contextlib.suppress(OSError):
                home.mkdir(exist_ok=True)
            _KERNELS.lock_path = home / "epcontact.lock"

        def load_overload(self, signature: Any, context: Any) -> Any:
            # Numba would load what only a compilation needs, which takes longer than
            # the kernels.
            context.refresh = functools.partial(rtsys.initialize, context)
            try:
                return super().load_overload(signature, context)
            except (
                Exception
            ):  # of a damaged file: what is kept of this kernel is made anew
                self.flush()
                return None
            finally:
                del context.refresh

    def cache_of(function: Any) -> Any:
        ours = function.__module__.partition(".")[0] in _PACKAGES
        return (Cache if ours else caching.FunctionCache)(function)

    dispatcher.FunctionCache = cache_of  # type: ignore[attr-defined]
    event.Listener.register(_Kernels)
    event.register("numba:compiler_lock", _KERNELS)
    event.register("numba:compile", _KERNELS)
    # At its end the interpreter would look through all objects of the compiler for
    # cycles, which takes as long as many a solve; the system gets their memory back
    # anyway.
    atexit.register(gc.freeze)


@functools.cache
def _stamp(folder: Path) -> bytes:
    """Return the digest of the sources in a folder."""
    sources = (path.read_bytes() for path in sorted(folder.glob("*.py")))
    return hashlib.sha256(b"".join(sources)).digest()
