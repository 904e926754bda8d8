"""Solves on a Dask cluster, for `--executor epcontact.harness.cluster:dask` (extra
`cluster`).

The environment variable DASK_SCHEDULER_ADDRESS names the scheduler, as `dask scheduler`
prints it:

    DASK_SCHEDULER_ADDRESS=tcp://10.0.0.1:8786

Its workers need the same versions of epcontact and of the numerical libraries and, to
write fields, the output folder of the sender.  Results are sent back.  Dask does the
tasks of a worker that dies again on another one.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import Executor

from epcontact.errors import InvalidCase, sentence_of

_VARIABLE = "DASK_SCHEDULER_ADDRESS"


def dask() -> Executor:
    """Return an executor on the cluster of the scheduler that the environment names.
    Its `worker_memory` is the memory, in bytes, of the largest worker that there is
    now; infinite where that is not known.
    """
    try:
        from distributed import Client
        from distributed.cfexecutor import ClientExecutor
    except ImportError:
        raise InvalidCase(
            "Dask is not installed; pip install 'epcontact[cluster]' brings it"
        ) from None

    class Dask(ClientExecutor):  # type: ignore[misc]
        """Closes its client, too, when it is shut down."""

        def shutdown(self, wait: bool = True, **_: object) -> None:
            super().shutdown(wait)
            self._client.close()

    address = os.environ.get(_VARIABLE, "")
    if not address:
        example = "the address of a Dask scheduler, such as tcp://10.0.0.1:8786"
        raise InvalidCase(f"{_VARIABLE} is not set; it must be {example}")
    try:
        client = Client(address, timeout=30)
    except (OSError, ValueError) as error:
        reason = f"where no Dask scheduler answers ({sentence_of(error)})"
        raise InvalidCase(f"{_VARIABLE} is {address}, {reason}") from None
    executor = Dask(client, pure=False)
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    executor.worker_memory = max(
        (w["memory_limit"] or math.inf for w in workers), default=math.inf
    )
    found: Executor = executor
    return found
