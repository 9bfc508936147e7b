"""One run of a sweep, in a process of its own: a signal handler wants a main thread, and what a run leaves behind ends
with the process."""

from __future__ import annotations

import io
import multiprocessing
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, TypeVar

from cell.errors import CellError
from cell.fleet.spec import Task

Row = dict[str, Any]
T = TypeVar("T")
RUNS_A_PROCESS = 100  # then it is begun anew, so that nothing grows
PARENT_S = 1.0  # how often a run's process looks whether its worker is still there
TRIES = 2  # a run that kills its process is tried once more
_pool: ProcessPoolExecutor | None = None
_folder: str | None = None  # of the run that goes on in this process
_lock = threading.Lock()


def run_task(task: Task) -> Row:
    """Run in the worker's child process; a run that brings the process down twice is a row that says so."""
    try:
        return in_child(run_here, task)
    except BrokenProcessPool:
        return {**_heading(task), "end": "crashed", "reason": "the run brought its process down", "took_s": 0.0}


def in_child(work: Callable[..., T], *arguments: Any) -> T:
    """What a function answers in the worker's child process.

    Raises:
        BrokenProcessPool: it brings the process down, twice.
    """
    global _pool
    with _lock:
        for tried in range(TRIES):
            if _pool is None:
                context = multiprocessing.get_context("spawn")
                _pool = ProcessPoolExecutor(
                    1, mp_context=context, initializer=_watch_parent, initargs=(os.getpid(),),
                    max_tasks_per_child=RUNS_A_PROCESS,
                )  # fmt: skip
            try:
                return _pool.submit(work, *arguments).result()
            except BrokenProcessPool:
                _pool = None
                if tried + 1 == TRIES:
                    raise
    raise AssertionError("tried at least once")


def run_here(task: Task) -> Row:
    """Run in this process; needs its main thread. Bad input is a row, too: the other runs go on."""
    global _folder
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory(prefix="cell-sweep-") as _folder:
        try:
            summary = _run(task, Path(_folder))
        except CellError as error:
            summary = {"end": "refused", "reason": str(error), "finished": False}
    took = {"took_s": round(time.perf_counter() - began_s, 3), "cpu_s": round(time.process_time() - began_cpu_s, 3)}
    return {**_heading(task), **summary, **took}


def _run(task: Task, folder: Path) -> dict[str, Any]:
    from rich.console import Console

    from cell.runs.options import RunOptions
    from cell.runs.run import run

    for name, content in task.files:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    log = folder / "run.mcap" if task.logs is None else Path(task.logs) / f"{task.key}.mcap"
    options = RunOptions(
        tree=folder / task.tree,
        configuration=folder / task.configuration,
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
    )
    return dict(run(options, Console(file=io.StringIO())).summary)


def _sent(folder: Path, name: str | None) -> str | None:
    """A name, or the file that came with the task."""
    return str(folder / name) if name is not None and (folder / name).is_file() else name


def _heading(task: Task) -> Row:
    return {"key": task.key, "seed": task.seed, **dict(task.label)}


def _watch_parent(parent: int) -> None:
    """A child ends with its worker, also with one that was killed, and leaves nothing behind."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_S)
        if _folder is not None:
            shutil.rmtree(_folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="watch parent").start()
