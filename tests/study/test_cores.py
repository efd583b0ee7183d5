"""Workers that fail and die: others finish, and what cannot be done is given up and named."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool

import pytest
from hypothesis import given
from hypothesis import strategies as st
from joblib.externals import loky

from coevo.study.cores import on_cores
from coevo.study.task import RETRIES, Done, Task

# How often a run fails before it succeeds: by an exception, and by the death of its process.
TROUBLES = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), max_size=7)


def pools(troubles):
    """Return a class of pools that keep to ``troubles``, and the count of how often each run was begun."""
    begun, raised, died = Counter(), Counter(), Counter()

    class Pool:
        def __init__(self, max_workers, initializer) -> None:
            assert max_workers >= 1
            assert callable(initializer)
            self.size, self.running, self.broken = max_workers, [], False

        def submit(self, _do, task):
            begun[task.name] += 1
            future = Future()
            self.running.append(future)
            assert len([one for one in self.running if not one.done()]) <= self.size
            exceptions, deaths = troubles[int(task.name)]
            if died[task.name] < deaths:
                died[task.name] += 1
                for one in self.running:
                    if not one.done():
                        one.set_exception(BrokenProcessPool("died"))
            elif raised[task.name] < exceptions:
                raised[task.name] += 1
                future.set_exception(OSError("the disk  is\naway"))
            else:
                future.set_result(Done(task.name, {"of": int(task.name)}, "", 1.0))
            return future

        def shutdown(self, *, wait, kill_workers):
            assert wait
            assert kill_workers in (True, False)

    return Pool, begun


@given(troubles=TROUBLES, workers=st.integers(1, 4))
def test_every_run_is_done_or_given_up_and_only_for_troubles_of_its_own(troubles, workers):
    pool, begun = pools(troubles)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loky, "ProcessPoolExecutor", pool)
        tasks = [Task(str(number), "", "", "", {}, {}) for number in range(len(troubles))]
        ended = {done.name: done for done in on_cores(tasks, workers)}
    assert sorted(ended) == sorted(task.name for task in tasks)
    for number, (exceptions, deaths) in enumerate(troubles):
        done = ended[str(number)]
        if deaths >= 3:
            assert done.row is None
            assert "its process died 3 times" in done.failure
        elif deaths == 2 and done.row is None:  # and once it was in company of another that died
            assert "its process died 3 times" in done.failure or exceptions > RETRIES
        elif exceptions <= RETRIES:
            assert done.row == {"of": number}
        else:
            assert done.failure == "OSError: the disk is away"
    assert all(begun.values())
