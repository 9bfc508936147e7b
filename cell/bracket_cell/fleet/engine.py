"""Runs on Dask: on this machine, or on any cluster whose scheduler is named.

A worker's trouble is not the run's: it goes elsewhere once more, and a worker that had two is left out. A frozen one
the scheduler begins anew, and gives its runs to others. Where the scheduler is gone, it is waited for, and what was
under way is handed out again.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import pickle
import signal
import sys
import tempfile
import time
from asyncio import CancelledError
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import resource_tracker
from typing import Any

from bracket_cell.fleet.one_run import ChildDied, Row, T, in_child, run_task
from bracket_cell.fleet.task import Task
from bracket_cell.packages import needed
from bracket_cell.recording.identity import code_version, versions
from bracket_ground.errors import CellError, InputError, words_of

WAITING_PER_WORKER = 2  # runs that are handed out ahead, so that no worker waits and memory stays small
LOSSES = 20  # workers that may be lost over one run before it is given up
COLD_S = 90.0  # how long a cluster may be without a worker that can do the work
REFUSED_S = 10.0  # ... where none ever could, and all that are there were refused: others may be about to come
CONNECT_S = 15.0
AWAY_S = 90.0  # in which a scheduler must be back
GOES = 5  # times that it may go with nothing done in between
TROUBLES = 2  # after which a worker is left out, and a run goes nowhere else
FROZEN = "60s"  # a worker of this machine that says nothing for so long is begun anew
ANSWER_S = 20.0  # in which a worker hands over an answer that it has, and a scheduler names its workers
POLL_S = 2.0  # how often workers are looked for that came, and runs whose workers are gone
# Asked of every worker before its first run; sent as source, as a worker may lack the package.
FACTS = """
def facts():
    import platform
    try:
        from bracket_cell.recording.identity import code_version, versions
    except ImportError as error:
        return {"lacks": f"has no package cell ({error}); its Python is {platform.python_version()}"}
    return {**versions(), **code_version()}
"""


@contextmanager
def cluster(workers: int, address: str | None = None) -> Iterator[Any]:
    """A Dask client: of the scheduler at the address, or of as many processes on this machine.

    Raises:
        InputError: Dask is not installed, or no scheduler answers at the address.
    """
    distributed = needed("distributed", "cell lab sweep")
    dask = needed("dask", "cell lab sweep")
    settings = {
        "distributed.scheduler.allowed-failures": LOSSES,
        "distributed.worker.memory.terminate": False,
        "distributed.scheduler.worker-ttl": FROZEN,
    }
    for name in ("distributed", "distributed.client", "tornado", "asyncio"):  # what goes wrong there is said here
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    with dask.config.set(settings):
        if address is not None:
            try:
                client = distributed.Client(address, timeout=CONNECT_S)
            except (OSError, ValueError, TimeoutError) as error:
                why = " ".join(str(error).split())
                raise InputError(
                    f"--scheduler {address}: no Dask scheduler answers, like tcp://HOST:8786: {why}"
                ) from None
            with _closed(client):
                yield client
            return
        with (
            # of all that workers leave behind
            tempfile.TemporaryDirectory(prefix="cell-sweep-", ignore_cleanup_errors=True) as folder,
            dask.config.set({"temporary-directory": folder}),
        ):
            with _deaf():
                local = distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # HTTP at any port that is free
                    silence_logs=50,
                    env={"TMPDIR": folder},
                )
            with _closed(local), _closed(distributed.Client(local)) as client:
                yield client


@contextmanager
def _deaf() -> Iterator[None]:
    """Threads and processes that begin in here, and theirs, do not hear a Ctrl-C: it is for who waits for them."""
    resource_tracker.ensure_running()  # it unblocks the signal as it begins
    heard = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, heard)


@contextmanager
def _closed(opened: Any) -> Iterator[Any]:
    """Closes a part of Dask in the end. It may be late on a busy machine; what was worked out counts all the same."""
    try:
        yield opened
    finally:
        with suppress(TimeoutError):
            opened.close()


def results(client: Any, tasks: Iterable[Task], work: Callable[[Task], Row] = run_task) -> Iterator[Row]:
    """Rows as they come; tasks are taken from the iterable only as workers need them.

    A task whose worker was lost, or had trouble, goes to another one. One that loses every worker is a row that says
    so. Each task has one row, also where the scheduler went and came back.

    Raises:
        InputError: the scheduler did not come back.
    """
    for (task,), answer, error in _surviving(client, work, ((task,) for task in tasks), in_order=False):
        yield _row(task, answer, error)


def _surviving(
    client: Any, work: Callable[..., Any], arguments: Iterable[tuple[Any, ...]], *, in_order: bool
) -> Iterator[tuple[tuple[Any, ...], Any, BaseException | None]]:
    """As `_done`, also where the scheduler goes or freezes, and is back in time.

    Raises:
        InputError: it did not come back.
    """
    distributed = needed("distributed", "cell lab sweep")
    gone = (distributed.client.FuturesCancelledError, CancelledError, OSError)
    address, waiting, in_vain = client.scheduler.address, _Once(arguments), 0
    with ExitStack() as opened:
        while True:
            try:
                for job, answer, error in _done(client, work, waiting, in_order=in_order):
                    waiting.done(job)
                    in_vain = 0
                    yield job, answer, error
                return
            except gone as error:
                in_vain += 1
                client = opened.enter_context(_closed(_again(address, error, waiting.count, in_vain)))
                waiting.again()


def _row(task: Task, answer: Row | Trouble | None, error: BaseException | None) -> Row:
    if answer is not None and not isinstance(answer, Trouble):
        return answer
    reason = answer.words if error is None and answer is not None else _words(error or CellError("no answer"))
    row = {"end": "lost", "reason": reason, "took_s": 0.0}
    return {"key": task.key, "seed": task.seed, **dict(task.label), **row}


class _Once:
    """Arguments that are taken one by one, and those that must be taken again first.

    Attributes:
        count: how many are done.
    """

    def __init__(self, arguments: Iterable[tuple[Any, ...]]) -> None:
        self._arguments, self._taken, self._first = iter(arguments), dict[int, tuple[Any, ...]](), list[Any]()
        self.count = 0

    def done(self, job: tuple[Any, ...]) -> None:
        """It need not be taken again."""
        del self._taken[id(job)]
        self.count += 1

    def again(self) -> None:
        """Those that were taken and are not done come first."""
        self._first = list(self._taken.values())

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        while self._first:
            yield self._first.pop(0)
        for argument in self._arguments:
            self._taken[id(argument)] = argument
            yield argument


def _again(address: str, error: BaseException, done: int, in_vain: int) -> Any:
    """A client of a scheduler that is back.

    Args:
        in_vain: how often it was gone since something was done last.

    Raises:
        InputError: it did not come back in time, or comes and goes.
    """
    distributed = needed("distributed", "cell lab sweep")
    sys.stderr.write(f"cell: the scheduler {address} is gone ({type(error).__name__}); waiting for it\n")
    until_s = time.monotonic() + AWAY_S
    while time.monotonic() < until_s and in_vain <= GOES:
        with suppress(OSError, TimeoutError, ValueError):
            asyncio.run(asyncio.wait_for(_answers(address), ANSWER_S))  # a client of a frozen one is never made
            return distributed.Client(address, timeout=CONNECT_S)
        time.sleep(POLL_S)
    how = f"gone for {AWAY_S:g} s" if in_vain <= GOES else f"gone {in_vain} times with nothing done in between"
    what = f"--scheduler {address}: {how}; {done} runs of this call are done"
    raise InputError(f"{what}; the same command goes on with the rest")


async def _answers(address: str) -> None:
    async with needed("distributed", "cell lab sweep").rpc(address) as scheduler:
        await scheduler.identity(n_workers=0)


@dataclass(frozen=True)
class Trouble:
    """A worker could not do a run, for reasons of its machine: a full disk, for instance."""

    worker: str
    words: str


def on_worker(work: Callable[..., T], *arguments: Any) -> T | Trouble:
    """What a function answers, or the trouble that its worker has."""
    try:
        return work(*arguments)
    except OSError as error:
        distributed = needed("distributed", "cell lab sweep")
        return Trouble(distributed.get_worker().address, f"{type(error).__name__}: {words_of(error)}")


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
        InputError: the scheduler went and did not come back.
    """
    if workers == 1 and address is None:
        yield from (work(*argument) for argument in arguments)
        return
    with cluster(workers, address) as client:
        packed = needed("cloudpickle", "cell lab sweep").dumps(work)  # a child takes no function inside of another
        for _, answer, error in _surviving(client, partial(in_child, unpacked, packed), arguments, in_order=True):
            if error is None:
                if isinstance(answer, Trouble):
                    raise CellError(f"several workers had trouble, the last one: {answer.words}")
                yield answer
            elif isinstance(error, ChildDied) or type(error).__name__ == "KilledWorker":
                raise CellError(f"a worker was lost again and again: {_words(error)}") from error
            else:
                raise error


def _done(
    client: Any, work: Callable[..., Any], arguments: Iterable[tuple[Any, ...]], *, in_order: bool
) -> Iterator[tuple[tuple[Any, ...], Any, BaseException | None]]:
    """Arguments with answer or error, in order or as they are done; arguments are taken only as workers need them.

    Only workers that agree with this program get any; one that is not there any more is made good by the others.
    """
    distributed = needed("distributed", "cell lab sweep")
    waiting, pending, crew = iter(arguments), dict[Any, tuple[tuple[Any, ...], set[str]]](), _Crew(client)
    troubled, again = dict[int, set[str]](), list[tuple[Any, ...]]()
    try:
        while True:
            crew.look()
            pending = {_submitted(client, work, job, crew): (job, set(crew.agreeing)) for job in again} | pending
            again = []
            for job in itertools.islice(waiting, max(0, crew.room - len(pending))):
                pending[_submitted(client, work, job, crew)] = job, set(crew.agreeing)
            if not pending:
                return
            first = next(iter(pending))
            with suppress(TimeoutError):
                distributed.wait([first] if in_order else list(pending), timeout=POLL_S, return_when="FIRST_COMPLETED")
            done = [future for future in ([first] if in_order else list(pending)) if future.done()]
            for future in done:
                with suppress(TimeoutError):  # else its worker has the answer, and says nothing
                    answer, error = _answer(future)
                    job, _ = pending.pop(future)
                    if isinstance(answer, Trouble) and crew.had(answer, troubled, job):
                        again.append(job)
                        continue
                    troubled.pop(id(job), None)
                    yield job, answer, error
            pending = {_kept(client, work, job, entry, crew): entry for job, entry in pending.items()}
    finally:
        with suppress(Exception):  # of a scheduler that is gone there is nothing to cancel
            client.cancel(list(pending))


def _answer(future: Any) -> tuple[Any, BaseException | None]:
    """Of a future that is done: what its work answers, or raises; TimeoutError where that does not come."""
    if future.status == "finished":
        return future.result(timeout=ANSWER_S), None
    error = future.exception(timeout=ANSWER_S)
    if future.status == "cancelled" or isinstance(error, CancelledError):
        raise error  # the scheduler is gone: it is nobody's answer
    return None, error


def _submitted(client: Any, work: Callable[..., Any], job: tuple[Any, ...], crew: _Crew) -> Any:
    return client.submit(on_worker, work, *job, pure=False, workers=sorted(crew.agreeing))


def _kept(
    client: Any, work: Callable[..., Any], future: Any, told: tuple[tuple[Any, ...], set[str]], crew: _Crew
) -> Any:
    """A future that somebody works on; handed out anew where all are gone that might have."""
    job, asked = told
    if asked & crew.agreeing or not crew.agreeing or future.done():
        return future
    client.cancel([future])
    asked.update(crew.agreeing)
    return _submitted(client, work, job, crew)


class _Crew:
    """The workers of a cluster: those that agree with this program, and why the others do not.

    Attributes:
        agreeing: their addresses.
    """

    def __init__(self, client: Any) -> None:
        self._client, self._refused, self._asked = client, dict[str, str](), dict[str, Any]()
        self._here = {**versions(), **code_version()}
        self._since_s, self._troubles = time.monotonic(), Counter[str]()
        self._facts: dict[str, Any] = {"__name__": "__main__"}
        exec(FACTS, self._facts)
        self.agreeing: set[str] = set()
        self.room = 0

    def look(self) -> None:
        """Ask workers that are new, and forget those that are gone, until there is one that agrees.

        Raises:
            InputError: for a while there was none; says why.
        """
        ever = bool(self.agreeing)
        while True:
            asking = self._client.scheduler.identity  # `scheduler_info` would wait for a frozen one without end
            there = self._client.sync(asking, n_workers=-1, callback_timeout=ANSWER_S)["workers"]
            for address in self._asked.keys() - there.keys():
                del self._asked[address]
            for address in sorted(self.agreeing - there.keys()):
                sys.stderr.write(f"cell: worker {address} is gone; others do its runs\n")
            self.agreeing &= there.keys()
            for address, worker in there.items():
                self._ask(address, str(worker.get("name", address)))
            self.room = WAITING_PER_WORKER * sum(there[address]["nthreads"] for address in self.agreeing)
            if self.agreeing or not all(call.done() for call in self._asked.values()):  # one that is asked may agree
                self._since_s = time.monotonic()
            if self.agreeing:
                return
            refused = not ever and bool(self._refused) and there.keys() <= self._refused.keys()
            if time.monotonic() - self._since_s > (REFUSED_S if refused else COLD_S):
                none = f"no worker came within {COLD_S:g} s"
                raise InputError("; ".join([*([] if refused else [none]), *self._refused.values()]))
            time.sleep(POLL_S / 10)

    def _ask(self, address: str, name: str) -> None:
        """Whether it agrees; one that does not answer is waited for beside the work, as it may be frozen."""
        if address in self.agreeing or address in self._refused:
            return
        if address not in self._asked:
            self._asked[address] = self._client.submit(self._facts["facts"], pure=False, workers=[address], priority=1)
        elif self._asked[address].status == "finished":
            self._judge(name, address, self._asked[address].result())
        elif self._asked[address].done():
            del self._asked[address]  # it went while it was asked, and is here again

    def had(self, trouble: Trouble, troubled: dict[int, set[str]], job: tuple[Any, ...]) -> bool:
        """Note a worker's trouble; whether the run is to go to another worker, also to one that is still asked."""
        where = troubled.setdefault(id(job), set())
        where.add(trouble.worker)
        self._troubles[trouble.worker] += 1
        if self._troubles[trouble.worker] == TROUBLES:
            self._refused[trouble.worker] = f"worker {trouble.worker} is left out, as it had trouble: {trouble.words}"
            self.agreeing.discard(trouble.worker)
            sys.stderr.write(f"cell: {self._refused[trouble.worker]}\n")
        return len(where) < TROUBLES

    def _judge(self, name: str, address: str, answers: dict[str, str]) -> None:
        others = [
            f"{key.removeprefix('version.')} {answers.get(key)}, here {value}"
            for key, value in self._here.items()
            if answers.get(key) != value
        ]
        if why := answers.get("lacks") or ", ".join(others):
            self._refused[address] = f"worker {name} does not agree and gets no runs: {why}"
            sys.stderr.write(f"cell: {self._refused[address]}\n")
        else:
            self.agreeing.add(address)


def unpacked(packed: bytes, *arguments: Any) -> Any:
    """Call a function that was packed."""
    return pickle.loads(packed)(*arguments)


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]
