"""Libraries that are loaded without threads of their own; this module loads nothing heavy."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

#: numpy starts the threads of its linear algebra when it is imported, unless it may have only one.
LINEAR_ALGEBRA = "OPENBLAS_NUM_THREADS"
#: ducc0 starts its threads when it first transforms, unless it may have only one.
TRANSFORMS = "DUCC0_NUM_THREADS"


@contextlib.contextmanager
def single_threads(*names: str) -> Iterator[None]:
    """Set variables of the environment to one thread, and then back to what they were."""
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
