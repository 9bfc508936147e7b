"""Everything that is shipped, trained again by the command on its model card: one process for each training."""

from __future__ import annotations

import shlex
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from bracket_cell.commands.options import told_in
from bracket_cell.commands.terminal import console
from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.kinds import TRAINED_DEFAULTS, WEIGHTS
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.settings import Perception
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore
from bracket_ground.interfaces.planning import weights_file
from bracket_lab.commands.training.made_data import Children, fingerprint
from bracket_lab.commands.training.weights import seconds

HIDDEN = "_train"  # the command of `tasks`; an installed cell has no `cell lab train`
ROWS = "training.jsonl"
PAPER_GRASP_S, PLANNER_S = 420.0, 60.0  # of processor time; these commands take no --budget
PLANNERS = {"semantic": "factored", "grasp": "pairwise"}  # those that a cell uses by default
PAPERS = {"actions": "paper", "parts": "rcnn", "semantic": "paper", "grasp": "paper"}  # the paper's own
LATENCY_FRAMES, LATENCY_TRAYS, LATENCY_SEED = 120, 20, 800_000


@dataclass(frozen=True)
class Step:
    """One training.

    Attributes:
        words: after `cell lab train`.
        files: what it writes, the one that `--out` names first.
        seconds: of processor time, about.
    """

    words: tuple[str, ...]
    files: tuple[str, ...]
    seconds: float

    @property
    def command(self) -> str:
        """As a line; the same on the model card."""
        return shlex.join(["cell", "lab", "train", *self.words])


def train_steps(steps: Sequence[Step], out: Path, config: Path, *, jobs: int, plan: bool) -> None:
    """Train into a folder what is not in it yet; interrupted, the same call goes on there.

    Args:
        plan: say what would be done, and do nothing.

    Raises:
        InputError: the folder cannot be used, or a training failed.
    """
    configuration = load_configuration(config)
    product = load_product(configuration, config)
    say = console().print
    kept = _kept(out, config)
    _say_plan(steps, [step for step in steps if not _made(step, out, kept)], f"{product.name}, into {out}/", jobs)
    if plan:
        return
    rows, trainings = kept or _rows(out, config), Children()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: no training goes on alone
    with ThreadPoolExecutor(jobs) as pool:
        begun = [
            pool.submit(_do, step, out, config, rows, f"{number} of {len(steps)}", trainings, quiet=jobs > 1)
            for number, step in enumerate(steps, 1)
        ]
        try:
            for future in as_completed(begun):
                future.result()
        except KeyboardInterrupt:
            say("interrupted; the same command goes on with what is not made yet", highlight=False)
            pool.shutdown(wait=False, cancel_futures=True)
            trainings.interrupt()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
    if all((out / f"{name}_{kind}.onnx").exists() for name, kind in TRAINED_DEFAULTS.items()):
        _note_latencies(configuration, config, out)
    say(f"in {config}:", highlight=False)
    for line in _lines(out, config):
        say(line, highlight=False)


@cache
def steps_of_shipped() -> tuple[Step, ...]:
    """The commands on the cards of all shipped weights, each once, the longest first."""
    files: dict[str, list[str]] = {}
    for path in sorted(WEIGHTS.iterdir(), key=lambda path: (len(path.stem), path.name)):
        if path.suffix == ".onnx":
            files.setdefault(OnnxModel.card_of(path).command, []).append(path.name)
    steps = []
    for command, names in files.items():
        words = shlex.split(command.removeprefix("cell ").removeprefix("lab ").removeprefix("train "))
        budget = words[words.index("--budget") + 1] if "--budget" in words else ""
        fixed_s = PAPER_GRASP_S if {"grasp", "paper"} <= set(words) else PLANNER_S
        steps.append(Step(tuple(words), tuple(names), seconds(budget) if budget else fixed_s))
    return tuple(sorted(steps, key=lambda step: -step.seconds))


def of_paper(step: Step) -> bool:
    """Whether a training is one of the paper's own system."""
    return any({"--kind", kind} <= set(step.words) for name, kind in PAPERS.items() if step.words[0] == name)


def scaled(steps: Sequence[Step], budget: str | None) -> list[Step]:
    """The detectors' budgets, all longer or shorter by the same factor."""
    if budget is None:
        return list(steps)
    factor = seconds(budget) / max(1.0, sum(step.seconds for step in steps if "--budget" in step.words))
    scaled = []
    for step in steps:
        words = list(step.words)
        if "--budget" in words:
            words[words.index("--budget") + 1] = f"{max(1, round(factor * step.seconds))}s"
        share = factor if "--budget" in words else 1.0
        scaled.append(Step(tuple(words), step.files, step.seconds * share))
    return scaled


def _say_plan(steps: Sequence[Step], left: Sequence[Step], what: str, jobs: int) -> None:
    """All trainings, and how long those take that are left."""
    say = console().print
    whole, jobs = _words(sum(step.seconds for step in left)), max(jobs, 2)
    busy_s = [0.0] * jobs
    for step in left:
        busy_s[busy_s.index(min(busy_s))] += step.seconds
    long = f"about {whole} of one CPU core" if left else "nothing is left"
    beside = f", {_words(max(busy_s))} with --jobs {jobs}" if len(left) > 1 else ""
    say(f"for {what}: {long}{beside}", highlight=False)
    for step in steps:
        length = _words(step.seconds) if step in left else "made before"
        say(f"- {step.command} ({length}): {', '.join(step.files)}", highlight=False)


def _made(step: Step, out: Path, rows: RowStore | None) -> bool:
    """Whether a training was done before, and its files are still there."""
    done = rows is not None and step.command in rows
    return done and all((out / name).exists() for name in step.files)


def _kept(out: Path, config: Path) -> RowStore | None:
    """What was trained into a folder before; None where it is not there, or empty.

    Raises:
        InputError: it holds the shipped weights, or others that this command did not make for this product; or it
            is not a folder, nor can be one.
    """
    if file := next((path for path in (out, *out.parents) if path.is_file()), None):
        raise InputError(f"--out {out}: {file} is a file; name a folder")
    if out.resolve() == WEIGHTS.resolve():
        raise InputError(f"--out {out}: holds the shipped weights; name another folder")
    kept = out / ROWS
    if out.is_dir() and any(out.iterdir()) and not kept.exists():
        raise InputError(f"--out {out}: is not empty, and nothing in it was made by `cell train --all`")
    return _rows(out, config) if kept.exists() else None


def _rows(out: Path, config: Path) -> RowStore:
    """The rows of a folder, one for each training that is done.

    Raises:
        InputError: they are of another product, or damaged.
    """
    try:
        return RowStore(out / ROWS, ["command"], {"command": "train --all", "made_for": fingerprint(config)})
    except InputError as error:
        raise InputError(
            f"--out {out}: was made for another product or bench, or its {ROWS} is damaged; name another folder"
        ) from error


def _do(step: Step, out: Path, config: Path, rows: RowStore, place: str, trainings: Children, *, quiet: bool) -> None:
    """Train, unless that was done.

    Args:
        quiet: what the training says goes into a file beside its weights.

    Raises:
        InputError: it failed, or did not write what it should.
    """
    say = console().print
    if _made(step, out, rows):
        say(f"{place}: {step.command}: made before", highlight=False)
        return
    say(f"{place}: {step.command}", highlight=False)
    words = [*step.words, "--overwrite", "--config", str(config), "--out", str(out / step.files[0])]
    began_s, said = time.monotonic(), (out / step.files[0]).with_suffix(".txt")
    with said.open("w") if quiet else nullcontext() as output:
        status = trainings.run([sys.executable, "-m", "bracket_cell", HIDDEN, *words], output)
    if status:
        why = f" (see {said})" if quiet else ""
        raise InputError(f"`{step.command}` ended with status {status}{why}; the same command goes on there")
    missing = [name for name in step.files if not (out / name).exists()]
    if missing:
        raise InputError(f"`{step.command}` wrote no {', '.join(missing)}")
    wall_s = time.monotonic() - began_s
    rows.add({"command": step.command, "wall_s": round(wall_s, 1)})
    say(f"{place}: made in {_words(wall_s)}", highlight=False)


def _note_latencies(configuration: Configuration, config: Path, out: Path) -> None:
    """Measure how long answers take, as a run in lock-step wants to know, and write that onto the cards."""
    from bracket_lab.wiring.latency import answers_ms, latencies_ms, note_latencies

    trained = configuration.model_copy(update={"perception": Perception(kind="learned", folder=out.resolve())})
    product = load_product(configuration, config)
    found = latencies_ms(simulated(trained, "varied"), product, LATENCY_FRAMES, LATENCY_TRAYS, LATENCY_SEED)
    noted = answers_ms(found)
    note_latencies(trained.perception, noted)
    text = ", ".join(f"{name} {value} ms" for name, value in noted.items())
    console().print(f"an answer takes (95 %): {text}", highlight=False)


def _words(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} minutes"


def _lines(out: Path, config: Path) -> list[str]:
    """What takes the weights into use."""
    perception = [f"perception: {{kind: learned, folder: {told_in(config, out)}}}"]
    if not all((out / weights_file(name, kind)).exists() for name, kind in TRAINED_DEFAULTS.items()):
        perception = _own("perception", TRAINED_DEFAULTS, out, config)
    return [*perception, *_own("planners", PLANNERS, out, config)]


def _own(section: str, usual: Mapping[str, str], out: Path, config: Path) -> list[str]:
    """A line for each network that is in the folder: of its usual kind, or of the paper's."""
    each = []
    for name, kind in usual.items():
        kinds = (kind, PAPERS.get(name, kind))
        found = next((kind for kind in kinds if (out / weights_file(name, kind)).exists()), None)
        if found is not None:
            weights = told_in(config, out / weights_file(name, found))
            each.append(f"  {name}: {{kind: {found}, weights: {weights}}}")
    return [f"{section}:", *each] if each else []
