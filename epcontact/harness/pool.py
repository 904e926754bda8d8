"""Calls spread over processes: a process that dies costs its own call and no other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from queue import SimpleQueue
from typing import TypeVar

from epcontact.harness.child import Child, ChildDied
from epcontact.machine import available_cores

Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(
    function: Callable[[Item, int], Result], items: Sequence[Item], jobs: int
) -> Iterator[tuple[Item, Result | str]]:
    """Yield (item, function(item, threads)) as the calls finish.

    Args:
        function: a function at module level, so that a process can import it.
        items: the arguments, one for each call.
        jobs: number of processes; with 1, the calls are made in this process.

    Returns:
        Pairs in any order.  If a process dies, a sentence replaces the result of its call.
    """
    jobs = min(jobs, len(items))
    threads = max(1, available_cores() // max(1, jobs))
    if jobs <= 1:
        for item in items:
            yield item, function(item, threads)
        return
    children, idle = [Child() for _ in range(jobs)], SimpleQueue[Child]()
    for child in children:
        idle.put(child)

    def call(item: Item) -> Result | str:
        child = idle.get()
        try:
            return child.call(function, item, threads)
        except ChildDied as error:
            return f"its process {error}"
        finally:
            idle.put(child)

    with ThreadPoolExecutor(jobs) as pool:
        finished = False
        try:
            futures = {pool.submit(call, item): item for item in items}
            for future in as_completed(futures):
                yield futures[future], future.result()
            finished = True
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in children:
                child.end(now=not finished)
