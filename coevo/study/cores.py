"""Workers of a study on the cores of this machine: processes, one run each at a time."""

from __future__ import annotations

import os
import signal
from collections import Counter, deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from coevo.study.task import RETRIES, Done, Task, describe_failure, do

__all__ = ["on_cores", "one_thread_each"]

_DEATHS = 3  # of the process of one run, which then is given up


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that start in the block do linear algebra with one thread, as its last bits depend on how many."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
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


def on_cores(tasks: Sequence[Task], workers: int) -> Iterator[Done]:
    """Do tasks in processes, and yield what became of each as it ends.

    When a process dies, those runs that were under way are done again one at a time, so that it shows whose fault it
    was; a run whose process dies three times is given up.
    """
    waiting, suspects, failures = deque(tasks), deque[Task](), Counter[str]()
    with one_thread_each():
        while waiting:
            suspects += yield from _pool(waiting, workers, failures)
        while suspects:
            suspect = suspects.popleft()
            deaths = 1
            while deaths < _DEATHS and (yield from _pool(deque([suspect]), 1, failures)):
                deaths += 1
            if deaths == _DEATHS:
                reason = f"its process died {deaths} times: it was killed, or memory was short"
                yield Done(suspect.name, None, reason, 0.0)


def _pool(waiting: deque[Task], workers: int, failures: Counter[str]) -> Generator[Done, None, list[Task]]:
    """Do the tasks that wait; if a process dies, stop, and return those that were under way.

    ``failures`` counts how often each was tried again.
    """
    from joblib.externals.loky import ProcessPoolExecutor  # noqa: PLC0415 - only who runs studies needs it

    size = min(workers, len(waiting))
    pool = ProcessPoolExecutor(max_workers=size, initializer=_leave_interrupts_to_the_parent)
    running: dict[Future[Done], Task] = {}
    try:
        while waiting or running:
            while waiting and len(running) < size:
                task = waiting.popleft()
                running[pool.submit(do, task)] = task
            dead: list[Task] = []
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, error = running.pop(future), future.exception()
                if error is None:
                    yield future.result()
                elif isinstance(error, BrokenProcessPool):
                    dead.append(task)
                elif failures[task.name] < RETRIES:
                    failures[task.name] += 1
                    waiting.append(task)
                else:
                    yield Done(task.name, None, describe_failure(error), 0.0)
            if dead:
                return [*dead, *running.values()]
        return []
    finally:
        pool.shutdown(wait=True, kill_workers=bool(running))


def _leave_interrupts_to_the_parent() -> None:
    """Ctrl-C at a terminal goes to all processes; the parent ends the others, and a run is safe at any instant."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
