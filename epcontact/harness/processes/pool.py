"""Calls spread over an executor, which is a pool of processes here or whatever a user names.

Any factory of a `concurrent.futures.Executor` will do: the workers of a cluster as well as those of
this machine.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any, TypeVar

from epcontact.errors import EpcontactError, InvalidCase, sentence_of
from epcontact.harness.processes.child import Child, ChildDied
from epcontact.harness.processes.template import POSSIBLE, Template

Item = TypeVar("Item")
Result = TypeVar("Result")

#: A function that makes an executor, or its name, `module:function`.
Factory = str | Callable[[], Executor]


class Processes(ThreadPoolExecutor):
    """Processes of this machine as an executor: each thread waits for the calls of a `Child`.

    A process that dies costs its own call and no other; `child` says why it is not a library's.
    """

    def __init__(
        self, jobs: int, load: Callable[..., object] | None = None, *arguments: Any
    ) -> None:
        super().__init__(jobs)
        self._template = Template(load, *arguments) if load is not None and POSSIBLE else None
        copied = {} if self._template is None else {"copied": self._template.copy}
        self._children, self._idle = [Child(**copied) for _ in range(jobs)], SimpleQueue[Child]()
        for child in self._children:
            self._idle.put(child)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a process call `fn`, a function at module level."""
        return super().submit(self._call, fn, *args, **kwargs)

    def _call(self, function: Callable[..., Result], *arguments: Any) -> Result:
        child = self._idle.get()
        try:
            return child.call(function, *arguments)
        finally:
            self._idle.put(child)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: at once, or (wait=True) after what they are doing."""
        super().shutdown(wait=False, cancel_futures=cancel_futures)
        if self._template is not None and not wait:
            self._template.end()  # first, because a process may wait for it
        for child in self._children:
            child.end(now=not wait)
        if self._template is not None:
            self._template.end()
        super().shutdown(wait=True)


def made(factory: Factory) -> Executor:
    """Return the executor that a factory makes.

wait() missing 1 required positional argument: 'fs'); give module:function, which is called \
without arguments
    """
    name = factory if isinstance(factory, str) else getattr(factory, "__name__", repr(factory))
    try:
        function = pkgutil.resolve_name(factory) if isinstance(factory, str) else factory
        executor = function()
    except EpcontactError:
        raise
    except (Exception, SystemExit) as error:
        raise InvalidCase(
            f"executor {name} cannot be made ({sentence_of(error)}); give module:function, which "
            "is called without arguments"
        ) from None
    if not isinstance(executor, Executor):
        raise InvalidCase(f"executor {name} is {executor!r:.60}, not a concurrent.futures.Executor")
    return executor


def spread(
    function: Callable[[Item], Result], items: Sequence[Item], executor: Executor
) -> Iterator[tuple[Item, Result | str]]:
    """Yield (item, function(item)) as the calls finish, then shut the executor down."""
    futures: dict[Future[Result], Item] = {}
    done, finished = SimpleQueue[Future[Result]](), False
    try:
        for item in items:
            future = _submitted(executor, function, item)
            futures[future] = item
            future.add_done_callback(done.put)
            while not done.empty():  # an executor may make a call when it takes it
                ended = done.get()
                result = _result(ended)
                yield futures.pop(ended), result
        while futures:
            ended = done.get()
            result = _result(ended)
            yield futures.pop(ended), result
        finished = True
    finally:
        for future in futures:
            future.cancel()
        try:
            executor.shutdown(wait=finished)
        except Exception as error:
            raise EpcontactError(f"the executor does not end: {sentence_of(error)}") from None


def _submitted(
    executor: Executor, function: Callable[[Item], Result], item: Item
) -> Future[Result]:
    try:
        return executor.submit(function, item)
    except Exception as error:
        raise EpcontactError(f"the executor takes no task: {sentence_of(error)}") from None


def _result(future: Future[Result]) -> Result | str:
    try:
        return future.result()
    except ChildDied as error:
        return f"its process {error}"
    except Exception as error:
        return f"its worker failed: {sentence_of(error)}"
