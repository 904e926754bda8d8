"""The cores and the memory of this process, and the cache of its compiled kernels.

A kernel is a function that numba compiles to machine code.  Numba saves the code in a
folder beside the source or in the user's cache.  If it can write to neither, it refuses
to define a kernel; a temporary folder is then created, and removed when the process
ends.  Two errors of numba are prevented here.  First, processes that write the files of
one kernel at the same time may leave code for the wrong types.  A file lock therefore
lets one process compile at a time.  Second, the compiler (LLVM) calls Python and drops
an exception that a signal handler raises during such a call.  A signal handler
therefore asks `compiling` first.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import hashlib
import logging
import math
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

try:
    import fcntl
except ImportError:  # Windows: numba replaces no file that another process reads
    fcntl = None  # type: ignore[assignment]

# Objects created between two searches for reference cycles while a kernel compiles.
_OBJECTS = 100_000
#: Environment variable for the threads of numpy's linear algebra, which numpy starts
#: when it is imported unless the variable is "1".
LINEAR_ALGEBRA = "OPENBLAS_NUM_THREADS"
#: Environment variable for the threads of ducc0's Fourier transforms, which ducc0
#: starts at the first transform unless the variable is "1".
TRANSFORMS = "DUCC0_NUM_THREADS"
# ducc0 cannot be imported if one of these variables is not a number.
for _name in (TRANSFORMS, "OMP_NUM_THREADS"):
    if not os.environ.get(_name, "0").strip().isdecimal():
        del os.environ[_name]
# Packages whose kernels use the cache of `provide_kernel_cache`; the kernels of other
# packages use numba's own cache.
_PACKAGES = ("epcontact", "fem_check")


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def available_memory() -> int:
    """Return the bytes of memory that this process may still take."""
    return int(psutil.virtual_memory().available)


def address_space_limit() -> float:
    """Return the largest address space in bytes that this process may have.

    It is the limit of `ulimit -v`, and infinite without one or on Windows.
    """
    if sys.platform == "win32":
        return math.inf
    import resource  # does not exist on Windows

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def processor_seconds() -> float:
    """Return the processor time in seconds of all threads of this process and of its
    children that have ended.
    """
    ended = os.times()
    return time.process_time() + ended.children_user + ended.children_system


def children() -> set[psutil.Process]:
    """Return the processes that this process started and that still run.

    Children of children count, too.
    """
    return set(psutil.Process().children(recursive=True))


def children_seconds(earlier: Set[psutil.Process]) -> float:
    """Return the processor time in seconds of the children of this process that run.

    earlier: children whose time is left out, as `children` returned them.  They are
    named because the system tells the start of a process only to within a second.
    """
    seconds = 0.0
    for child in children() - earlier:
        with contextlib.suppress(psutil.Error):
            of_child = child.cpu_times()
            seconds += of_child.user + of_child.system
    return seconds


def forget_peak() -> None:
    """Reset the peak that `peak_memory` returns to the present memory of this process.

    Only Linux can do this; on other systems the function does nothing.
    """
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory() -> int:
    """Return the largest resident memory of this process in bytes.

    It is the largest since the last call of `forget_peak`, or since the process began.
    """
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    with contextlib.suppress(OSError):
        status = Path("/proc/self/status").read_text("ascii", errors="replace")
        for line in status.splitlines():
            if line.startswith("VmHWM:"):
                kibibytes = int(line.split()[1])
                return 1024 * kibibytes
    import resource  # does not exist on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if sys.platform == "darwin":  # in bytes; elsewhere in KiB
        return peak
    return 1024 * peak


def alive(pid: int) -> bool:
    """Return True if the process with the number `pid` runs on this machine.

    The result is False for a zombie, that is, for a process that has ended and whose
    parent has not yet read its exit code.
    """
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def try_lock(descriptor: int) -> bool:
    """Lock an open file or folder for this process, and return False if another has it.

    The result is True, too, on systems and file systems that have no locks.  The lock
    ends when the descriptor is closed or the process ends.

    Args:
        descriptor: The number of the open file or folder, from `os.open`.
    """
    if fcntl is not None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True
    return True


def describe_death(code: int | None) -> str:
    """Return words for how a process ended, such as "ended with exit code 1".

    The subject of the sentence is missing: the caller puts the process before it.

    Args:
        code: its exit code; -n if the signal n ended it, None if epcontact ended it.
    """
    if code is None:
        return "was ended"
    if code >= 0:
        return f"ended with exit code {code}"
    names = {number.value: number.name for number in signal.Signals}
    name = names.get(-code, f"signal {-code}")
    causes = {
        "SIGKILL": " (most likely for want of memory)",
        "SIGSEGV": " (invalid memory access)",
    }
    return f"was killed by {name}{causes.get(name, '')}"


@contextlib.contextmanager
def single_threads(*names: str) -> Iterator[None]:
    """Set environment variables to "1" in a `with` block, and restore them after it.

    names: environment variables that hold a number of threads, such as LINEAR_ALGEBRA.
    """
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class _Kernels:
    """A listener to numba that counts the time for kernels and holds a file lock.

    Processes that load compiled kernels share the lock; a process that compiles holds
    it alone.

    Attributes:
        depth: number of compilations or loads that have begun and not ended; a kernel
            compiles the kernels that it calls.
        total: seconds of all compilations and loads that have ended.
        started: `time.perf_counter` at the beginning of the outermost one that runs.
        lock_path: the file to lock; None until a kernel is defined.
    """

    def __init__(self) -> None:
        """Start with no work on kernels, and without a lock."""
        self.depth = 0
        self.total = 0.0
        self.started = 0.0
        self.lock_path: Path | None = None
        self._mutex = threading.RLock()
        self._lock = contextlib.ExitStack()  # closes the locked file
        self._user_informed = False
        self._has_compiled = False  # since the outermost beginning
        # Whether the next kernel is locked for compilation at once: true at first and
        # after a kernel that was missing in the cache.
        self._expects_missing = True
        self._thresholds = gc.get_threshold()

    def notify(self, event: Any) -> None:
        """Handle an event of numba; numba calls this method in any thread.

        event: `numba.core.event.Event`.  The kind "numba:compiler_lock" marks the
        beginning or end of any work on a kernel, and "numba:compile" that of a
        compilation, which happens only if the cache lacks the kernel.
        """
        if event.kind == "numba:compiler_lock":
            with self._mutex:
                if event.is_start:
                    self._begin()
                else:
                    self._end()
        elif event.is_start:
            if not self._user_informed:
                logging.getLogger("epcontact").warning(
                    "epcontact compiles kernels that this machine has not used before; "
                    "the time for it counts neither as cost nor against a time limit"
                )
            self._user_informed = True
            self._has_compiled = True
            if not self._expects_missing:
                self._wait_for_lock(exclusive=True)

    def _begin(self) -> None:
        """Count one more begun work on a kernel; at the first, start the clock.

        The first one also waits for the file lock.  An exception of a signal handler
        during this wait is raised again after the count is restored.
        """
        self.depth += 1
        if self.depth > 1:
            return
        self.started = time.perf_counter()
        self._thresholds = gc.get_threshold()
        # A compiler creates so many objects that searches for reference cycles would
        # take a seventh of its time.
        gc.set_threshold(max(_OBJECTS, self._thresholds[0]), *self._thresholds[1:])
        try:
            self._wait_for_lock(exclusive=self._expects_missing)
        except BaseException:  # an interrupt while another process compiles
            self._end()
            raise

    def _end(self) -> None:
        """Count one fewer begun work; after the last, add its time and unlock."""
        self.depth -= 1
        if not self.depth:
            gc.set_threshold(*self._thresholds)
            self.total += time.perf_counter() - self.started
            # After a missing kernel others are likely to be missing.  Exclusive locks
            # from the start let several processes compile different ones in turn.
            self._expects_missing = self._has_compiled
            self._has_compiled = False
            self._lock.close()

    def _wait_for_lock(self, *, exclusive: bool) -> None:
        """Release the file lock and wait until this process has it again.

        It does nothing where files cannot be locked or the folder is read-only.

        exclusive: whether to wait for all processes that work on kernels; otherwise
        only for one that holds the lock exclusively, because it compiles.
        """
        self._lock.close()
        with contextlib.suppress(OSError):
            if fcntl is not None and self.lock_path is not None:
                file = self._lock.enter_context(self.lock_path.open("ab"))
                fcntl.flock(file, fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH)


_KERNELS = _Kernels()


def compile_seconds() -> float:
    """Return the seconds that this process has spent on compiling and loading kernels.

    Compilation that is still running counts, and so does the time for which this
    process waited while another process compiled.
    """
    if not _KERNELS.depth:
        return _KERNELS.total
    return _KERNELS.total + time.perf_counter() - _KERNELS.started


@dataclass
class Stopwatch:
    """Adds up the time of `with` blocks, without that in which kernels are compiled.

    Attributes:
        seconds: wall time of all blocks that have ended.
        processor_seconds: processor time of these blocks, with all threads.
        running: True inside of a block.
    """

    seconds: float = 0.0
    processor_seconds: float = 0.0
    running: bool = False

    def __enter__(self) -> None:
        """Start the time of a block, which must not be inside of another one."""
        self.running = True
        self._started = time.perf_counter() - compile_seconds()
        self._processor_started = time.process_time() - compile_seconds()

    def __exit__(self, *_: object) -> None:
        """Add the time of the block."""
        compiling = compile_seconds()
        self.seconds += time.perf_counter() - compiling - self._started
        self.processor_seconds += (
            time.process_time() - compiling - self._processor_started
        )
        self.running = False


def compiling() -> bool:
    """Return True if this process is compiling or loading a kernel.

    A signal handler must not raise an exception then, because the compiler drops it;
    the handler must be called again later.
    """
    return _KERNELS.depth > 0


@functools.cache
def provide_kernel_cache() -> None:
    """Make numba use a safe cache for the kernels of this package; see the module.

    It must be called before a kernel is defined; further calls do nothing.  Numba has
    no settings for this, so its class of caches is replaced for the kernels of
    _PACKAGES.
    """
    # Imported here because most commands solve nothing, and numba takes half a second.
    from numba.core import caching, config, dispatcher, event
    from numba.core.runtime import rtsys

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        """Numba's cache of one kernel on disk, which also sets the path of the lock."""

        def __init__(self, function: Any) -> None:
            """Find the folder of the cache, and of the lock, for a Python function.

            If numba finds no folder that it can write to, a temporary one is created.
            """
            try:
                super().__init__(function)
            except RuntimeError:  # numba can write to none of the folders that it tries
                temporary = tempfile.mkdtemp(prefix="epcontact-kernels-")
                atexit.register(shutil.rmtree, temporary, ignore_errors=True)
                # Child processes inherit the variable.
                os.environ["NUMBA_CACHE_DIR"] = temporary
                config.reload_config()
                super().__init__(function)
            source_folder = Path(function.__code__.co_filename).parent
            cache_folder = Path(self.cache_path)
            # Numba compiles a kernel anew if its file has changed, but not if the file
            # of a kernel that it calls has.
            with contextlib.suppress(AttributeError):  # a private name of numba
                self._cache_file._source_stamp = _stamp(source_folder)
            # One lock for all kernels: beside the sources each folder has a cache of
            # its own, elsewhere all caches are in one folder.
            lock_folder = cache_folder.parent
            if lock_folder == source_folder:
                lock_folder = Path(__file__).parent / "__pycache__"
            with contextlib.suppress(OSError):
                lock_folder.mkdir(exist_ok=True)
            _KERNELS.lock_path = lock_folder / "epcontact.lock"

        def load_overload(self, signature: Any, context: Any) -> Any:
            """Return the compiled kernel for argument types; None if it is missing.

            A damaged cache counts as missing and is deleted.  signature, context: the
            argument types and the target of the compiler, as numba passes them.
            """
            # Numba would prepare the compiler first, which takes longer than to load
            # a kernel.  Loading needs only the runtime.
            context.refresh = functools.partial(rtsys.initialize, context)
            try:
                return super().load_overload(signature, context)
            except Exception:  # unpickling a damaged file may raise anything
                self.flush()
                return None
            finally:
                del context.refresh

    def cache_of(function: Any) -> Any:
        """Return a new cache for a kernel: `Cache` for those of _PACKAGES.

        function: the Python function of the kernel.
        """
        package = function.__module__.partition(".")[0]
        if package in _PACKAGES:
            return Cache(function)
        return caching.FunctionCache(function)

    dispatcher.FunctionCache = cache_of  # type: ignore[attr-defined]
    event.Listener.register(_Kernels)
    event.register("numba:compiler_lock", _KERNELS)
    event.register("numba:compile", _KERNELS)
    # When Python ends, it searches all objects of the compiler for reference cycles,
    # which takes as long as many solves.  The system frees their memory anyway.
    atexit.register(gc.freeze)


@functools.cache
def _stamp(folder: Path) -> bytes:
    """Return the SHA-256 digest (32 bytes) of the Python sources in a folder."""
    sources = (path.read_bytes() for path in sorted(folder.glob("*.py")))
    return hashlib.sha256(b"".join(sources)).digest()
