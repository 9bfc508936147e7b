"""Runs on Dask: on this machine, or on any cluster whose scheduler is named; a lost worker loses nothing."""

from __future__ import annotations

import itertools
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from typing import Any

from cell.errors import CellError
from cell.files.packages import needed
from cell.fleet.one_run import Row, T, in_child, run_task
from cell.fleet.spec import Task

WAITING_PER_WORKER = 2  # runs that are handed out ahead, so that no worker waits and memory stays small
LOSSES = 20  # workers that may be lost over one run before it is given up
COLD_S = 60.0  # how long a cluster may take to show its first worker


@contextmanager
def cluster(workers: int, address: str | None = None) -> Iterator[Any]:
    """A Dask client: of the scheduler at the address, or of as many processes on this machine.

    Raises:
        InputError: Dask is not installed.
    """
    distributed = needed("distributed", "cell lab sweep")
    dask = needed("dask", "cell lab sweep")
    settings = {
        "distributed.scheduler.allowed-failures": LOSSES,
        "distributed.worker.daemon": False,  # a worker's runs have processes of their own
        "distributed.worker.memory.terminate": False,
    }
    with dask.config.set(settings):
        if address is not None:
            with distributed.Client(address, timeout=COLD_S) as client:
                yield client
            return
        with (
            tempfile.TemporaryDirectory(prefix="cell-sweep-") as folder,  # of all that workers leave behind
            dask.config.set({"temporary-directory": folder}),
            distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # its HTTP server takes any port that is free
                silence_logs=50,
                env={"TMPDIR": folder},
            ) as local,
            distributed.Client(local) as client,
        ):
            yield client


def results(client: Any, tasks: Iterable[Task], work: Callable[[Task], Row] = run_task) -> Iterator[Row]:
    """Rows as they come; tasks are taken from the iterable only as workers need them.

    A task whose worker was lost goes to another one. One that loses every worker is a row that says so.
    """
    for (task,), future in _done(client, work, ((task,) for task in tasks), in_order=False):
        yield _row(future, task)


def mapped(
    work: Callable[..., T], arguments: Iterable[tuple[Any, ...]], workers: int = 1, address: str | None = None
) -> Iterator[T]:
    """What a function answers to each of the arguments, in their order: one by one in this process, or by workers.

    Each is called in a process of its own. Arguments are taken only as workers need them, and what is still under way
    when nobody wants more is given up. So the answers are the same as those of one call after the other.

    Args:
        work: what it names must be there for workers, too; nothing else is sent along.
        workers: processes on this machine; 1 for none but this one.
        address: of a Dask scheduler, in their place.

    Raises:
        CellError: as the function raises it, or a call brought down every process that tried it.
    """
    if workers == 1 and address is None:
        yield from (work(*one) for one in arguments)
        return
    with cluster(workers, address) as client:
        packed = needed("cloudpickle", "cell lab sweep").dumps(work)  # a pool takes no function inside of another
        for _, future in _done(client, partial(in_child, unpacked, packed), arguments, in_order=True):
            yield _answer(future)


def _done(
    client: Any, work: Callable[..., Any], arguments: Iterable[tuple[Any, ...]], *, in_order: bool
) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Arguments with their futures, in order or as they are done; arguments are taken only as workers need them."""
    client.wait_for_workers(1, timeout=COLD_S)
    waiting, pending = iter(arguments), dict[Any, tuple[Any, ...]]()
    done = needed("distributed", "cell lab sweep").as_completed()
    try:
        while True:
            for one in itertools.islice(waiting, max(0, _room(client) - len(pending))):
                pending[future := client.submit(work, *one, pure=False)] = one
                if not in_order:
                    done.add(future)
            if not pending:
                return
            first = next(iter(pending)) if in_order else next(done)
            yield pending.pop(first), first
    finally:
        client.cancel(list(pending))


def unpacked(packed: bytes, *arguments: Any) -> Any:
    """Call a function that was packed."""
    return pickle.loads(packed)(*arguments)


def _answer(future: Any) -> Any:
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker":
        raise CellError(f"a worker was lost again and again: {error}") from error
    raise error


def _room(client: Any) -> int:
    """How many runs may be handed out at once."""
    threads: int = sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())
    return WAITING_PER_WORKER * max(1, threads)


def _row(future: Any, task: Task) -> Row:
    error = future.exception()
    if error is None:
        row: Row = future.result()
        return row
    told = {"end": "lost", "reason": f"{type(error).__name__}: {error}".splitlines()[0], "took_s": 0.0}
    return {"key": task.key, "seed": task.seed, **dict(task.label), **told}
