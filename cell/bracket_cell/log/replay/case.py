"""A log as a small regression case: what every tick saw and decided, the tree and the weights; no images, no frames."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.inference.onnx_model import sealed, without_digest
from bracket_cell.log.read.reader import Log, LoggedTick, read_log
from bracket_cell.log.replay.compare import Difference
from bracket_cell.log.replay.loading import Changes, recorded_weights
from bracket_cell.log.replay.logged_tree import unpacked
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.copying import CopyingWriter
from bracket_ground.errors import InputError, LogError
from bracket_ground.files.files import whole_or_none

LARGEST_BYTES = 1_000_000
CHUNK_BYTES = 32 * 1024 * 1024  # one chunk, so that it is packed as a whole
TICK_TOPICS = (
    "/edit",
    "/hook",
    "/observation",
    "/bench",
    "/parts",
    "/judgement",
    "/tick",
    "/command",
    "/display",
    "/timing",
)
WEIGHTS = "weights/"


def write_case(log: Log, path: Path, until_s: float = math.inf) -> int:
    """Write what a replay needs of a log, up to a time; returns the size in bytes.

    Raises:
        LogError: there is no tick, or the weights of the recording are not here.
        InputError: the case cannot be written, or is 1 MB or more.
    """
    if not log.ticks or log.ticks[0].time_s > until_s:
        raise LogError(log.path, f"holds no tick up to {until_s:g} s")
    weights = _weights(log)
    try:
        content = BytesIO()
        _write(log, weights, until_s, content)
        size = len(content.getvalue())
        if size >= LARGEST_BYTES:
            limit = f"legal: less than {LARGEST_BYTES}; shorten it with --until"
            raise InputError(f"{path}: the case would have {size} bytes; {limit}")
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_or_none(path) as partial:
            partial.write_bytes(content.getvalue())
    except OSError as error:
        raise InputError(f"{path}: the case cannot be written: {error.strerror or error}") from None
    return size


def check_case(path: Path) -> list[Difference]:
    """Tick a case again on its own weights; differences beyond rounding, none where all decisions are as they were."""
    log = read_log(path)
    found: list[Difference] = []
    with tempfile.TemporaryDirectory(prefix="cell-case-") as folder:
        weights = {}
        for name, content in log.attachments.items():
            if name.startswith(WEIGHTS):
                file = Path(folder) / Path(name).name
                file.write_bytes(sealed(without_digest(content)))  # older cases hold them without a digest
                weights[file.stem] = file
        comparison = Replay(log, Changes(weights=weights)).run(watch=lambda step: found.extend(step.differences))
    if comparison.ticks != len(log.ticks):
        last: LoggedTick = log.ticks[comparison.ticks - 1]
        found.append(Difference(last.number, last.time_s, "length", len(log.ticks), comparison.ticks))
    return found


def _weights(log: Log) -> dict[str, bytes]:
    """Content of the ONNX files that the run used, by planner."""
    for name in ("configuration.yaml", "product.yaml"):
        if name not in log.attachments:
            raise LogError(log.path, f"has no attachment {name}")
    with unpacked(log, log.attachments) as folder:
        planners = load_configuration(folder / "configuration.yaml", rested=False).planners
    files = {name: recorded_weights(log, name, planner) for name, planner in planners}
    return {name: file.read_bytes() for name, file in files.items() if file is not None}


def _write(log: Log, weights: Mapping[str, bytes], until_s: float, stream: Any) -> None:
    writer = CopyingWriter(stream, CHUNK_BYTES, renumber=True)
    writer.start("cell", "cell log to-test")
    for name, content in {
        **log.attachments,
        **{f"{WEIGHTS}{name}.onnx": weight for name, weight in weights.items()},
    }.items():
        writer.attach(name, content)
    writer.note("run", dict(log.metadata))
    end_ns = round(min(until_s, log.ticks[-1].time_s) * 1e9)  # what follows the last whole tick is no part of it
    for message in log.messages:
        topic = message.topic
        if message.time_ns <= end_ns and (topic in TICK_TOPICS or topic.startswith("/note/")) and topic != "/note/why":
            writer.channel(topic, message.encoding, "cell.Any", "jsonschema", b'{"type": "object"}')
            writer.message(topic, message.time_ns, message.data)
    writer.note("outcome", dict(log.outcome) if until_s == math.inf else {"end": "trimmed"})
    writer.finish()
