"""The modules that the server of a pool loads before processes are forked from it, see
`processes`.

These are the methods that the environment names, with those of their kernels that this
machine has compiled before.  No library may start a thread: what one holds during a
fork is held for ever.
"""

from __future__ import annotations

import contextlib
import gc
import os
from typing import Any

from epcontact.machine import LINEAR_ALGEBRA, TRANSFORMS, single_threads

with contextlib.suppress(Exception), single_threads(LINEAR_ALGEBRA, TRANSFORMS):
    from numba.core import event

    class _Missing(event.Listener):  # type: ignore[misc]
        def on_start(self, _: Any) -> None:
            raise LookupError("this machine has not kept the kernel")

        def on_end(self, _: Any) -> None:
            pass

    with event.install_listener("numba:compile", _Missing()):
        import epcontact.harness.answers.run  # noqa: F401
        from epcontact.harness.methods.registry import METHODS

        for name in os.environ.get("EPCONTACT_PRELOAD", "").split():
            with contextlib.suppress(LookupError):
                METHODS[name].load()

gc.freeze()  # the collector would write to the pages that copies share
