"""Where compiled kernels are kept, if neither the package nor the user's home can be written.

Numba keeps compiled code beside its source or else in the user's cache, and where it can write
to neither it refuses to define the function at all.  A package installed by the administrator
and run by a service without a home is just that, so that a private folder, gone with the process
that made it, takes their place.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"


def provide() -> None:
    """Name a folder for numba that can be written, if nothing else can; processes started from
    this one inherit it.  To be called before kernels are defined."""
    here = Path(__file__).parent
    sources = (here / "bem", here.parent / "fem_check")
    named = os.environ.get(_VARIABLE)
    if named and _writable(Path(named)):
        return
    if all(_writable(source / "__pycache__") for source in sources):
        return
    # Where numba looks next: see numba.core.caching.
    if _writable(_users_cache()):
        return
    try:
        folder = tempfile.mkdtemp(prefix="epcontact-kernels-")
    except OSError:
        return
    os.environ[_VARIABLE] = folder
    if "numba" in sys.modules:
        sys.modules["numba"].config.reload_config()
    atexit.register(_remove, folder, os.getpid())


def _writable(folder: Path) -> bool:
    """Whether a file can be made in `folder`, which is made first where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _users_cache() -> Path:
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "numba"
    if os.name != "posix":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "numba"


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)
