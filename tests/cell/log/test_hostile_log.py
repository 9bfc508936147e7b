"""A log is data: whatever it says, nothing of it is called, and what is wrong with it is one line."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import orjson
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from bracket_cell.learned.inference.onnx_model import sealed, without_digest
from bracket_cell.log.read.indexed import IndexedLog
from bracket_cell.log.read.mcap_file import Message
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.read.resume import after_tick
from bracket_cell.log.read.ticks import TickBuilder
from bracket_cell.log.replay.case import WEIGHTS
from bracket_cell.log.replay.compare import logged
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.logged_tree import logged_product
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.schemas import json_bytes
from bracket_cell.wiring.run_state import state_of
from bracket_ground.errors import CellError, LogError
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resume import ResumeState
from tests.cell.log.hostile import EDITS, Audit, flipped

CASE = Path(__file__).parents[2] / "cases" / "assembly-g0-seed5.mcap"
KEPT_AT, TICKS = 90, 6  # a tick in the middle of a skill; ticks that are replayed from it
MANY = int(os.environ.get("HOSTILE_LOGS", "1500"))  # examples of each kind, where there is time
FEW = {
    "deadline": None,
    "suppress_health_check": list(HealthCheck),
    "database": None,
    "phases": (Phase.explicit, Phase.generate),
}
AUDIT = Audit()


def weights_of(log: Log, folder: Path) -> dict[str, Path]:
    """The weights that a case holds, in files."""
    found = {}
    for name, content in log.attachments.items():
        if name.startswith(WEIGHTS):
            found[Path(name).stem] = folder / Path(name).name
            found[Path(name).stem].write_bytes(sealed(without_digest(content)))
    return found


class Kept:
    """A case, its state after a tick in the middle of a skill, and a replay that may begin there."""

    def __init__(self, folder: Path) -> None:
        self.log = read_log(CASE)
        self.product: Product = logged_product(self.log)
        self.replay = Replay(self.log, Changes(weights=weights_of(self.log, folder)))
        self.replay.run(until_s=self.log.ticks[KEPT_AT].time_s)
        self.state = self.written()
        assert b"bracket_cell.skills.grasping" in orjson.dumps(self.state), "no skill was at work"
        ends = [place for place, message in enumerate(self.log.messages) if message.topic == "/timing"]
        self.messages = self.log.messages[: ends[20] + 1]

    def written(self) -> Any:
        """The state now, as a log has it."""
        replay = self.replay
        return orjson.loads(json_bytes(state_of(replay.tree, replay._services, replay._supervisor)))

    def go_on(self, state: Any) -> None:
        """Take a state up and tick on, as a replay does."""
        replay = self.replay
        before = self.log.ticks[KEPT_AT]
        object.__setattr__(before, "state", state)
        replay._services.now.observation = before.observation
        replay._go_on(before)
        replay._place = KEPT_AT + 1
        replay.run(until_s=self.log.ticks[KEPT_AT + TICKS].time_s)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    return Kept(tmp_path_factory.mktemp("kept"))


def try_states(kept: Kept, examples: int) -> None:
    kept.go_on(kept.state)  # what is imported when it is needed is there now
    outcomes = {"refused": 0, "taken": 0}

    @settings(max_examples=examples, **FEW)  # type: ignore[arg-type]
    @given(edits=EDITS)
    def tried(edits: Any) -> None:
        state, replay = flipped(kept.state, edits), kept.replay
        with AUDIT.listening():
            try:
                kept.go_on(orjson.loads(orjson.dumps(state, option=orjson.OPT_NON_STR_KEYS, default=str)))
                outcomes["taken"] += 1
            except CellError as error:
                outcomes["refused"] += "\n" not in str(error).strip()
        replay.remarks.clear()

    tried()
    assert outcomes["refused"] > examples // 10, outcomes
    assert sum(outcomes.values()) >= examples, f"not all refusals are one line with the log's name: {outcomes}"


@pytest.mark.long
def test_a_state_that_lies_is_refused_or_harmless(kept: Kept) -> None:
    try_states(kept, 60)


@pytest.mark.slow
def test_many_states_that_lie_are_refused_or_harmless(kept: Kept) -> None:
    try_states(kept, MANY)


def test_a_sound_state_goes_on_identical(kept: Kept) -> None:
    """Else the tests above would try nothing."""
    kept.go_on(kept.state)
    before = kept.replay.log.ticks[KEPT_AT]
    kept.replay._begin(KEPT_AT + 1)
    kept.replay._place = KEPT_AT + 1
    compared = kept.replay.run(until_s=before.time_s + 1.0)
    assert compared.agrees, compared.first
    assert compared.ticks > TICKS


def read_again(kept: Kept, messages: list[Message]) -> None:
    """What every reader of a log does with its ticks."""
    builder, left = TickBuilder(CASE), ResumeState()
    builder.begin(0)
    for message in messages:
        builder.take(message)
    for tick in builder.take_away():
        logged(tick)
        left = after_tick(left, tick, kept.product, CASE, remembers=True)


def try_messages(kept: Kept, examples: int) -> None:
    read_again(kept, list(kept.messages))
    outcomes = {"refused": 0, "taken": 0}
    topics = sorted({message.topic for message in kept.messages if message.encoding == "json"})

    @settings(max_examples=examples, **FEW)  # type: ignore[arg-type]
    @given(topic=st.sampled_from(topics), number=st.integers(0, 20), edits=EDITS)
    def tried(topic: str, number: int, edits: Any) -> None:
        alike = [place for place, message in enumerate(kept.messages) if message.topic == topic]
        place, messages = alike[number % len(alike)], list(kept.messages)
        told = flipped(orjson.loads(messages[place].data), edits)
        lying = orjson.dumps(told, option=orjson.OPT_NON_STR_KEYS, default=str)
        messages[place] = replace(messages[place], data=lying)
        with AUDIT.listening():
            try:
                read_again(kept, messages)
                outcomes["taken"] += 1
            except CellError as error:
                outcomes["refused"] += str(CASE) in str(error)

    tried()
    assert outcomes["refused"] > examples // 10, outcomes
    assert sum(outcomes.values()) >= examples, f"not all refusals are one line with the log's name: {outcomes}"


def test_messages_that_lie_are_refused_or_harmless(kept: Kept) -> None:
    try_messages(kept, 100)


@pytest.mark.slow
def test_many_messages_that_lie_are_refused_or_harmless(kept: Kept) -> None:
    try_messages(kept, MANY)


def test_a_bomb_that_the_index_names_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("cell", "cell")
        writer.add_message(writer.register_channel("/tick", "json", 0), 1, bytes(80_000_000), 1)
        writer.finish()  # type: ignore[no-untyped-call]
    assert path.stat().st_size < 20_000
    with pytest.raises(LogError, match="promises 80"):
        list(IndexedLog(path).messages())


@pytest.mark.parametrize("at", [0.5, 0.9])
@pytest.mark.parametrize("reverse", [False, True])
def test_a_damaged_chunk_is_told_where_it_is_needed(at: float, reverse: bool, tmp_path: Path) -> None:
    path, content = tmp_path / "flipped.mcap", bytearray(CASE.read_bytes())
    begin = content.index(b"zstd")
    content[begin + int(at * (len(content) - 60_000 - begin))] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(LogError, match="is damaged where it is needed: a chunk"):
        list(IndexedLog(path).messages(topics=("/tick",), reverse=reverse))


@pytest.mark.parametrize("reverse", [False, True])
def test_an_index_finds_what_a_reader_of_the_whole_log_finds(reverse: bool) -> None:
    whole = sorted(read_log(CASE).messages, key=lambda message: message.time_ns)
    found = list(IndexedLog(CASE).messages(reverse=reverse))
    assert found == (whole[::-1] if reverse else whole)
