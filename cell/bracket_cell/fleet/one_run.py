"""One run of a sweep, in a process of its own: a signal handler wants a main thread, and what a run leaves behind ends
with the process."""

from __future__ import annotations

import errno
import io
import math
import os
import pickle
import queue
import resource
import select
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from bracket_cell.fleet.store import is_address, put
from bracket_cell.fleet.table import order_id
from bracket_cell.fleet.task import Task
from bracket_cell.recording.parts import parts_of
from bracket_ground.errors import CellError

Row = dict[str, Any]
T = TypeVar("T")
RUNS_A_PROCESS = 100  # then it is begun anew, so that nothing grows
TRIES = 2  # a run that kills its process is tried once more
MOST_CPU_S, MOST_CPU_SHARE = 3600.0, 20.0  # of a run, and for each second that it may last: more, and it hangs
IDLE_S = 60.0  # a process that was asked and used no processor for this long is stopped, or waits for ever
GLANCE_S = 0.5  # between looks at it
LEAVES_S = 5.0  # in which one ends that is asked no more
OF_MACHINE = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.ENFILE, errno.EMFILE)
LENGTH = struct.Struct(">Q")  # before each answer
SERVE = "from bracket_cell.fleet.one_run import serve; serve({answers})"
_folder: str | None = None  # of the run that goes on in this process
_lock = threading.Lock()


class ChildDied(CellError):
    """A call brought its process down again and again."""


class _Child:
    """A process that answers calls, one after the other; it ends with this one, also where this one is killed.

    A program of its own and no `multiprocessing` child: a worker of Dask is a daemon, which may have none.
    """

    def __init__(self) -> None:
        reads, writes = os.pipe()
        program = [sys.executable, "-c", SERVE.format(answers=writes)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        own: dict[str, Any] = {"pass_fds": (writes,), "env": environment, "start_new_session": True}  # no Ctrl-C
        self._process = subprocess.Popen(program, stdin=subprocess.PIPE, **own)
        os.close(writes)
        assert self._process.stdin is not None
        self._calls, self._answers = self._process.stdin, os.fdopen(reads, "rb", 0)
        os.set_blocking(self._calls.fileno(), False)
        self.calls = 0
        self._worked_s, self._idle_since_s = -1.0, 0.0

    def call(self, work: Callable[..., T], *arguments: Any) -> T:
        """What it answers.

        Raises:
            ChildDied: it ended meanwhile, or hung and was ended; says how.
        """
        self.calls += 1
        self._worked_s = -1.0
        try:
            self._send(pickle.dumps((work, arguments)))
            (size,) = LENGTH.unpack(self._received(LENGTH.size))
            answer, error = pickle.loads(self._received(size))
        except TimeoutError:
            self._process.kill()
            self.close()
            idle = f"the run's process (pid {self._process.pid}) did nothing for {IDLE_S:g} s and was ended"
            raise ChildDied(f"{idle}: somebody stopped it, or it waited for something that never came") from None
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            status = self._process.wait()
            ended = f"by {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
            ended = "for using the processor without end" if status == -signal.SIGXCPU else ended
            self.close()
            raise ChildDied(f"the run's process (pid {self._process.pid}) ended {ended}") from None
        if error is not None:
            raise error
        found: T = answer
        return found

    def close(self) -> None:
        """Let it end, by force where it does not."""
        with suppress(BrokenPipeError):
            self._calls.close()
        self._answers.close()
        try:
            self._process.wait(LEAVES_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _send(self, data: bytes) -> None:
        left = memoryview(data)
        while left:
            self._await([], [self._calls])
            left = left[os.write(self._calls.fileno(), left[: select.PIPE_BUF]) :]

    def _received(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            self._await([self._answers], [])
            part = self._answers.read(count - len(data))
            if not part:
                raise EOFError
            data += part
        return data

    def _await(self, reads: list[Any], writes: list[Any]) -> None:
        """Until a pipe is ready; TimeoutError where the process uses no processor meanwhile."""
        while not any(select.select(reads, writes, [], GLANCE_S)):
            worked_s, now_s = self._processor_s(), time.monotonic()
            if worked_s != self._worked_s:
                self._worked_s, self._idle_since_s = worked_s, now_s
            elif now_s - self._idle_since_s > IDLE_S:
                raise TimeoutError

    def _processor_s(self) -> float:
        """What it has used so far, by all of its threads."""
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return time.monotonic()  # nobody counts here, or it has ended: the pipe tells
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


_child: _Child | None = None


def run_task(task: Task) -> Row:
    """Run in the worker's child process; a run that brings the process down twice is a row that says so."""
    try:
        return in_child(run_here, task)
    except ChildDied as error:
        return {**_heading(task), "end": "crashed", "reason": str(error), "took_s": 0.0}


def in_child(work: Callable[..., T], *arguments: Any) -> T:
    """What a function answers in the worker's child process.

    Raises:
        ChildDied: it brings the process down, twice.
    """
    global _child
    with _lock:
        for tried in range(TRIES):
            if _child is not None and _child.calls >= RUNS_A_PROCESS:
                _child.close()
                _child = None
            _child = _child or _Child()
            try:
                return _child.call(work, *arguments)
            except ChildDied:
                _child = None
                if tried + 1 == TRIES:
                    raise
    raise AssertionError("tried at least once")


def serve(answers: int) -> None:
    """Answer calls until nobody asks any more; the work of a child process."""
    calls, replies = sys.stdin.buffer, os.fdopen(answers, "wb")
    os.dup2(2, 1)  # what a run prints is no answer
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # which workers block: a run may be sent its own
    waiting: queue.Queue[Any] = queue.Queue()

    def listen() -> None:
        try:
            while True:
                waiting.put(pickle.load(calls))
        except Exception as error:  # its end, or a function that is not here
            if not isinstance(error, EOFError):
                waiting.put(error)
                return
            if _folder is not None:
                shutil.rmtree(_folder, ignore_errors=True)
            os._exit(0)

    threading.Thread(target=listen, daemon=True, name="calls").start()
    while True:
        call = waiting.get()
        answer: tuple[Any, BaseException | None] = (None, None)
        try:
            if isinstance(call, Exception):
                raise call
            work, arguments = call
            answer = work(*arguments), None
        except Exception as error:  # whatever it raises, it raises where it was called
            answer = None, error
        try:
            content = pickle.dumps(answer)
            pickle.loads(content)
        except Exception:  # an answer that cannot be sent, or not be read there
            content = pickle.dumps((None, CellError(f"{type(answer[1] or answer[0]).__name__}: {answer[1]}")))
        replies.write(LENGTH.pack(len(content)) + content)
        replies.flush()
        if isinstance(call, Exception):  # nobody reads further calls: the next one gets a new process
            return


def run_here(task: Task) -> Row:
    """Run in this process; needs its main thread. Bad input is a row, too: the other runs go on."""
    global _folder
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    most_s = MOST_CPU_S + MOST_CPU_SHARE * (task.max_duration_s or 0.0)
    with limited(most_s), tempfile.TemporaryDirectory(prefix="cell-sweep-") as _folder:
        try:
            summary = _run(task, Path(_folder))
        except CellError as error:
            if isinstance(cause := error.__context__, OSError) and cause.errno in OF_MACHINE:
                raise cause from None  # the worker's trouble, not the run's
            summary = {"end": "refused", "reason": str(error).replace(f"{_folder}/", ""), "finished": False}
    took = {"took_s": round(time.perf_counter() - began_s, 3), "cpu_s": round(time.process_time() - began_cpu_s, 3)}
    return {**_heading(task), **summary, **took}


@contextmanager
def limited(cpu_s: float) -> Iterator[None]:
    """The system ends this process if it uses so much more processor time."""
    before = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + cpu_s), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, before)


def _run(task: Task, folder: Path) -> dict[str, Any]:
    from rich.console import Console

    from bracket_cell.runs.options import RunOptions
    from bracket_cell.runs.run import run

    for name, content in task.packed.files:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    away = task.logs is not None and is_address(task.logs)
    log = folder / "run.mcap" if task.logs is None or away else Path(task.logs) / f"{task.key}.mcap"
    options = RunOptions(
        tree=folder / task.packed.tree,
        configuration=folder / task.packed.configuration,
        goal=task.goal,
        seed=task.seed,
        person=_sent(folder, task.person),
        look=_sent(folder, task.look),
        inject=task.fault,
        log=log,
        overwrite=True,
        max_duration_s=task.max_duration_s,
        images=task.logs is not None and task.pixels,
        pixels=task.pixels,
        one_process=True,
        nodes=tuple(str(folder / name) for name in task.packed.nodes),
    )
    summary = dict(run(options, Console(file=io.StringIO())).summary)
    summary["order_id"] = order_id(summary)
    if not task.keeps(summary):
        del summary["log"]
        for part in (log, *parts_of(log)):
            part.unlink(missing_ok=True)
    elif away:
        summary["log"] = f"{task.logs}/{task.key}.mcap"
        put(log, str(summary["log"]))
    return summary


def _sent(folder: Path, name: str | None) -> str | None:
    """Names with commas between them, those of files that came with the task by their places."""
    return name and ",".join(str(folder / part) if (folder / part).is_file() else part for part in name.split(","))


def _heading(task: Task) -> Row:
    return {"key": task.key, "seed": task.seed, **dict(task.label)}
