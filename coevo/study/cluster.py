"""Workers of a study on several machines, or in separate processes of this one, by ``dask.distributed``."""

from __future__ import annotations

import importlib.util
import logging
import signal
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from coevo.console import note
from coevo.errors import InputError
from coevo.study.cores import one_thread_each
from coevo.study.task import RETRIES, Done, Task, describe_failure, do

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["LOCAL", "check_installed", "connected", "on_cluster"]

LOCAL = "local"
# Of workers that may die with a run on hand before it is given up. A dying worker makes its waiting tasks suspect, too.
_ALLOWED_FAILURES = 10
_REACH_S = 10


def check_installed() -> None:
    """Refuse to go on without the library.

    Raises:
        InputError: with the remedy.
    """
    if importlib.util.find_spec("distributed") is None:
        raise InputError(
            "--scheduler needs the package distributed, which is not installed; install the extra:"
            " pip install 'coevo[cluster]'"
        )


@contextmanager
def connected(address: str, workers: int, *, quiet: bool) -> Iterator[Client]:
    """Return a client of a cluster: one that is running, or one of processes of this machine that ends with it.

    Args:
        address: of a scheduler, such as ``tcp://10.0.0.1:8786``, or ``local``.
        workers: processes of a local cluster.
        quiet: say nothing.

    Raises:
        InputError: there is no scheduler.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.comm import get_address_host_port

    with ExitStack() as stack:
        for name in [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what it says is told by what becomes of the runs
        if address == LOCAL:
            stack.enter_context(one_thread_each())
            stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": _ALLOWED_FAILURES}))
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
            stack.callback(cluster.close, timeout=5)
            client = stack.enter_context(Client(cluster, set_as_default=False))
            client.register_plugin(_ignoring_interrupts())
            yield client
            return
        try:
            get_address_host_port(address)  # a client that was made with nonsense complains when it ends
            client = stack.enter_context(Client(address, timeout=_REACH_S, set_as_default=False))
        except (OSError, ValueError, TypeError) as error:
            raise InputError(
                f"--scheduler: cannot reach a Dask scheduler at {address!r} ({describe_failure(error)}); start one with"
                " 'dask scheduler' and give its address, such as tcp://10.0.0.1:8786, or 'local'"
            ) from None
        client.run_on_scheduler(_allow_failures, _ALLOWED_FAILURES)
        if not client.nthreads():
            note("The scheduler has no workers yet; the study begins when the first one joins.", quiet=quiet)
        yield client


def _ignoring_interrupts() -> Any:
    """Return what lets each worker leave Ctrl-C, which a terminal sends to all processes, to the one that directs."""
    from distributed import WorkerPlugin

    class Ignoring(WorkerPlugin):  # type: ignore[misc]  # read as if it had no types
        def setup(self, worker: Any) -> None:  # noqa: ARG002 - Dask's signature; it is called in the main thread
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    return Ignoring()


def _allow_failures(number: int, dask_scheduler: Any = None) -> None:
    dask_scheduler.allowed_failures = max(number, dask_scheduler.allowed_failures)


def on_cluster(client: Client, tasks: Sequence[Task]) -> Iterator[Done]:
    """Do tasks on a cluster, and yield what became of each as it ends; those of a lost worker are done again."""
    from distributed import as_completed

    futures = {client.submit(do, task, pure=False, retries=RETRIES): task for task in tasks}
    try:
        for future in as_completed(list(futures), loop=client.loop):
            error = future.exception() if not future.cancelled() else None
            if future.cancelled():
                yield Done(futures[future].name, None, "the scheduler was stopped, or lost", 0.0)
            elif error is not None:
                yield Done(futures[future].name, None, describe_failure(error), 0.0)
            else:
                yield future.result()
            future.release()
    finally:
        client.cancel([future for future in futures if not future.done()])
