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
    """Return an executor on a Dask cluster.

    The environment variable DASK_SCHEDULER_ADDRESS names the scheduler of the cluster.
    The attribute `worker_memory` of the executor is the memory of the present largest
    worker, in bytes; it is infinite if a worker has no limit.

    Raises InvalidCase if Dask is not installed, if the variable is not set, or if no
    scheduler answers within 30 s.
    """
    try:
        from distributed import Client
        from distributed.cfexecutor import ClientExecutor
    except ImportError:
        raise InvalidCase(
            "Dask is not installed; pip install 'epcontact[cluster]' brings it"
        ) from None

    class Dask(ClientExecutor):  # type: ignore[misc]
        """An executor that leaves the cluster when it is shut down."""

        def shutdown(self, wait: bool = True, **_: object) -> None:
            """End this executor, after its running calls if `wait`, and disconnect."""
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
    limits = [worker["memory_limit"] or math.inf for worker in workers]
    executor.worker_memory = max(limits, default=math.inf)
    typed_executor: Executor = executor
    return typed_executor
