"""Replay of a log is the log; a change differs where it must and nowhere before."""

from __future__ import annotations

import dataclasses
import gc
import json
import re
import socket
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, ClassVar

import pytest
from rich.console import Console

from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.log.read.reader import Log, LoggedTick, read_log
from bracket_cell.log.read.ticks import Gap
from bracket_cell.log.replay.loading import Changes, load
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.log.report.query import Query, diff, info, query, ticks
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.viewing.monitor import HEADER, PROTOCOL, Monitor
from bracket_ground.errors import InputError, LogError
from btxml.engine.status import Status
from tests.cell.conftest import COMMISSION, changed_configuration
from tests.cell.log.read.test_reader import without

BARE: Any = {"images": False, "pixels": False, "one_process": True}
LEAVES = """
import sys
import tempfile
from contextlib import ExitStack
from bracket_cell.trees.nodes.services import CellNode

class Leaves(CellNode):
    def update(self):
        sys.exit(0)
"""


LEAVES_WHEN_HALTED = """
import sys
import tempfile
from contextlib import ExitStack
from btxml.engine.status import Status
from bracket_cell.trees.nodes.services import CellNode

class Leaves(CellNode):
    def update(self):
        return Status.RUNNING

    def terminate(self, new_status):
        if new_status is Status.INVALID:
            sys.exit(0)
"""


def first(log: Log, node: str) -> LoggedTick:
    """The tick in which a node was first started."""
    return next(
        tick
        for tick in log.ticks
        if any(node in change.path and change.new is Status.RUNNING for change in tick.changes)
    )


def test_the_same_decisions_follow_from_the_same_inputs(commission_log: Log) -> None:
    comparison = Replay(commission_log).run()
    assert comparison.identical, comparison.first
    assert comparison.ticks == len(commission_log.ticks)
    assert commission_log.outcome["end"] == "finished"
    assert sum(tick.command is not None for tick in commission_log.ticks) > 5, "nothing moved: nothing was compared"


def test_an_assembly_replays_too(assembly_log: Log) -> None:
    comparison = Replay(assembly_log).run()
    assert comparison.identical, comparison.first
    assert comparison.ticks == len(assembly_log.ticks)


@pytest.mark.parametrize("tells", [True, False])
def test_what_nodes_remember_is_compared_where_the_log_tells_it(assembly_log: Log, tells: bool) -> None:
    def forged(tick: LoggedTick) -> LoggedTick:
        notes = ((topic, {"held_part": "o9"} if "held_part" in fields else fields) for topic, fields in tick.notes)
        return dataclasses.replace(tick, notes=tuple(note for note in notes if tells or note[0] != "memory"))

    log = dataclasses.replace(assembly_log, ticks=tuple(forged(tick) for tick in assembly_log.ticks))
    comparison = Replay(log).run()
    assert set(comparison.first_by_aspect) == ({"memory"} if tells else set())
    assert diff(assembly_log, log).identical != tells


def test_another_hole_differs_from_the_tick_on_that_moves_there(commission_log: Log, tmp_path: Path) -> None:
    for file in COMMISSION.parent.glob("*.xml"):
        (tmp_path / file.name).write_text(file.read_text().replace("position := 'p3'", "position := 'p4'"))
    comparison = Replay(commission_log, Changes(tree=tmp_path / COMMISSION.name)).run()
    assert comparison.first is not None
    assert comparison.first_by_aspect["command"].tick == first(commission_log, "PlacePart").number
    assert comparison.first.tick >= first(commission_log, "PlacePart").number


def test_a_bolder_guard_acts_where_the_recorded_one_waited(assembly_log: Log, tmp_path: Path) -> None:
    config = changed_configuration(tmp_path, "wrong_act_s: 300.0", "wrong_act_s: 1.0")
    waited = next(tick for tick in assembly_log.ticks if any(topic == "verdict" for topic, _ in tick.notes))
    comparison = Replay(assembly_log, Changes(configuration=config)).run()
    verdict = comparison.first_by_aspect["verdict"]
    assert verdict.tick == waited.number
    assert (verdict.was[0]["decision"], verdict.now[0]["decision"]) == ("wait", "act")


@pytest.mark.parametrize("what", ["follow", "gripper"])
def test_a_command_that_differs_in_its_last_bit_is_rounded_otherwise(commission_log: Log, what: str) -> None:
    victim = next(tick for tick in commission_log.ticks if tick.command is not None and tick.command.get(what))
    assert victim.command is not None
    text = json.dumps(victim.command[what])
    number = next(word for word in text.replace("[", " ").replace("]", " ").replace(",", " ").split() if "0." in word)
    other = repr(float(number.strip("}")) + 1e-15)
    command = {**victim.command, what: json.loads(text.replace(number.strip("}"), other, 1))}
    ticks_with = tuple(
        dataclasses.replace(tick, command=command) if tick is victim else tick for tick in commission_log.ticks
    )
    comparison = Replay(dataclasses.replace(commission_log, ticks=ticks_with)).run(until_s=victim.time_s + 1.0)
    assert (comparison.rounded_ticks, comparison.agrees, comparison.identical) == (1, True, False)


def test_a_changed_input_is_noticed_where_no_decision_hangs_on_it(commission_log: Log) -> None:
    assert not commission_log.altered
    at = next(place for place, message in enumerate(commission_log.messages) if message.topic == "/observation")
    messages = list(commission_log.messages)
    messages[at] = dataclasses.replace(
        messages[at], data=messages[at].data.replace(b'"current_a":0.0', b'"current_a":0.1')
    )
    assert messages[at] != commission_log.messages[at]
    assert dataclasses.replace(commission_log, messages=tuple(messages)).altered


def test_a_range_is_compared_and_the_rest_is_ticked_silently(commission_log: Log) -> None:
    seen: list[Step] = []
    comparison = Replay(commission_log).run(1.0, 2.0, lambda step: seen.append(step))
    assert comparison.identical
    assert comparison.ticks == len(seen) == 26
    assert {"part", "position"} <= set(seen[-1].blackboard)


def test_other_weights_are_named(commission_log: Log) -> None:
    other = {**commission_log.metadata, "weights.grasp.sha256": "0123456789abcdef"}
    with pytest.raises(LogError, match=r"other grasp weights: 0123456789ab, but .*grasp_.*onnx is .* --weights grasp="):
        Replay(dataclasses.replace(commission_log, metadata=other))
    with pytest.raises(InputError, match=r"unknown planners \['vision'\]; legal: semantic, grasp"):
        Replay(commission_log, Changes(weights={"vision": Path("x")}))


def test_a_replay_names_versions_that_changed(commission_log: Log) -> None:
    older = dataclasses.replace(commission_log, metadata={**commission_log.metadata, "version.numpy": "1.0"})
    assert any("numpy was 1.0" in remark for remark in Replay(older).remarks)
    assert Replay(commission_log).remarks == []


def test_a_replay_ends_before_missing_ticks_and_says_so(
    commission_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ticks = commission_log.ticks[:20] + commission_log.ticks[23:]
    replay = Replay(dataclasses.replace(commission_log, ticks=ticks, gaps=(Gap(20, 22),)))
    comparison = replay.run()
    assert (comparison.identical, comparison.ticks) == (True, 20)
    assert replay.remarks == ["ticks 20 to 22 are missing: the replay ends before, as nodes remember what they saw"]
    log = tmp_path / "gap.mcap"
    log.write_bytes(commission_log.path.read_bytes())
    mended = without(log, 20, 21, 22)
    assert main(["replay", str(mended), "--json"]) == 1
    told = capsys.readouterr()
    assert json.loads(told.out)["ticks"] == read_log(mended).gaps[0].first < 23
    assert "are missing: the replay ends before" in told.err


class MeddlingMonitor(Monitor):
    """A monitor whose clients hold up a node for a while and then answer for another one."""

    asked = 0
    orders: ClassVar[dict[int, tuple[str, str, dict[str, object]]]] = {
        5: ("I", "LookAtTray", {"position": 0}),
        80: ("U", "LookAtTray", {"position": 0, "desired_status": "SKIPPED", "remove_when_done": True}),
        81: ("I", "PickPart", {"mode": 1, "once": True, "desired_status": "FAILURE", "position": 0}),
    }

    def serve(self) -> None:
        if self.asked in self.orders:
            kind, name, body = self.orders[self.asked]
            uid = next(node.uid for node in self._tree.nodes if node.full_path.split("/")[-1].startswith(name))
            head, *_ = self.answer([HEADER.pack(PROTOCOL, ord(kind), 1), json.dumps({**body, "uid": uid}).encode()])
            assert head != b"error"
        self.asked += 1


def test_a_node_that_ends_the_program_ends_neither_run_nor_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes, tree, path = tmp_path / "leaves.py", tmp_path / "tree.xml", tmp_path / "log.mcap"
    nodes.write_text(LEAVES)
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="T"><Leaves/></BehaviorTree></root>')
    monkeypatch.setenv("CELL_NODES", str(nodes))
    result = run(RunOptions(tree, DEFAULT_CONFIGURATION, "g0", 1, "fast", path, **BARE), Console(quiet=True))
    assert (result.outcome.end, result.outcome.reason) == (
        "fault",
        "SystemExit: 0, in Leaves (tree.xml:1), leaves.py:9",
    )
    comparison = Replay(read_log(path)).run()
    assert comparison.identical, comparison.first
    assert comparison.ticks > 0


def test_a_node_that_ends_the_program_when_halted_does_not_end_the_safe_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes, tree, path = tmp_path / "stays.py", tmp_path / "tree.xml", tmp_path / "log.mcap"
    nodes.write_text(LEAVES_WHEN_HALTED)
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="T"><Leaves/></BehaviorTree></root>')
    monkeypatch.setenv("CELL_NODES", str(nodes))
    configuration = changed_configuration(tmp_path / "config", "max_duration_s: 300.0", "max_duration_s: 1.0")
    result = run(RunOptions(tree, configuration, "g0", 1, "fast", path, **BARE), Console(quiet=True))
    assert result.outcome.exit_status != 0
    assert "the tree did not halt: SystemExit: 0" in str(result.outcome)
    comparison = Replay(read_log(path)).run()
    assert comparison.identical, comparison.first


@pytest.mark.long
def test_what_a_monitor_did_to_nodes_is_replayed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bracket_cell.viewing.monitor.Monitor", MeddlingMonitor)
    configuration = changed_configuration(tmp_path, "max_duration_s: 300.0", "max_duration_s: 4.5")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    path = tmp_path / "log.mcap"
    options = RunOptions(
        COMMISSION, configuration, "g0", 1, "fast", path, monitor_port=port, monitor_hooks=True, **BARE
    )
    run(options, Console(quiet=True))
    log = read_log(path)
    looked = first(log, "LookAtTray").number
    assert [tick.number for tick in log.ticks if tick.inputs] == [6, looked, looked + 1]
    assert any(
        "PickPart" in change.path and change.new is Status.FAILURE for tick in log.ticks for change in tick.changes
    )
    comparison = Replay(log).run()
    assert (comparison.identical, comparison.ticks) == (True, len(log.ticks)), comparison.first
    deaf = tuple(dataclasses.replace(tick, inputs=()) for tick in log.ticks)
    assert not Replay(dataclasses.replace(log, ticks=deaf)).run().identical
    another = Replay(log, Changes(tree=COMMISSION))
    assert not another.run().identical
    assert another.remarks[0].startswith("an order of a monitor at 0.24 s is left out")


def test_a_log_that_leads_out_of_its_folder_is_refused(commission_log: Log) -> None:
    hostile = {**commission_log.attachments, "../../outside": b""}
    with pytest.raises(LogError, match="leads out of its folder"):
        Replay(dataclasses.replace(commission_log, attachments=hostile))


def test_two_logs_differ_where_they_first_saw_or_did_otherwise(commission_log: Log, assembly_log: Log) -> None:
    assert diff(commission_log, commission_log).identical
    assert not diff(commission_log, assembly_log).identical
    shorter = dataclasses.replace(commission_log, ticks=commission_log.ticks[:-1])
    found = diff(commission_log, shorter)
    assert found.first is not None
    assert (found.first.aspect, found.first.tick) == ("length", commission_log.ticks[-1].number)


def test_questions_are_answered(commission_log: Log) -> None:
    assert info(commission_log)["ticks"] == len(commission_log.ticks)
    assert info(commission_log)["topics"]["/tick"]["messages"] == len(commission_log.ticks)
    started = list(query(commission_log, Query(node="PlacePart", status="RUNNING")))
    assert started[0]["tick"] == first(commission_log, "PlacePart").number
    looked = [entry for entry in query(commission_log, Query(topic="command", key="look")) if entry["look"]]
    assert len(looked) >= 1
    assert all(1.0 <= entry["time_s"] <= 2.0 for entry in ticks(commission_log, 1.0, 2.0, all_ticks=True))


def test_commands_answer_with_exit_status_and_json(
    commission_log: Log, assembly_log: Log, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(commission_log.path)
    assert main(["replay", log, "--until", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["identical"]
    assert main(["log", "diff", log, str(assembly_log.path), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["first"]["tick"] == 0
    assert main(["log", "info", log, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outcome"]["end"] == "finished"
    assert main(["log", "query", log, "--status", "LATE"]) == 2
    assert "legal: RUNNING" in capsys.readouterr().err
    assert main(["replay", str(COMMISSION)]) == 2
    assert "is not an MCAP file" in capsys.readouterr().err


def test_a_replay_opens_no_simulator(commission_log: Log) -> None:
    script = (
        "import sys; from bracket_cell.commands.main import main;"
        f"status = main(['replay', {str(commission_log.path)!r}, '--until', '0.5']);"
        "loaded = {'bracket_sim.scene.world', 'bracket_sim.cell', 'mujoco', 'torch'} & set(sys.modules);"
        "sys.exit(f'loaded {loaded}' if loaded else status)"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_a_product_that_no_weights_know_is_replayed_as_it_was_run(assembly_log: Log) -> None:
    renamed = {
        name: re.sub(rb"\bo1\b", b"ball", content) if name in ("configuration.yaml", "product.yaml") else content
        for name, content in assembly_log.attachments.items()
    }
    other = dataclasses.replace(assembly_log, attachments=renamed)
    with ExitStack() as files:
        configuration, product, planners, _, _ = load(other, Changes(), {}, files)
    assert "ball" in product.parts
    assert configuration.perception.kind == "classical"
    assert planners.confusions is None  # those on the card of trained detectors say nothing about colours


def test_what_a_replay_unpacked_goes_with_it(tray_log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    replay = Replay(tray_log)
    assert len([*tmp_path.iterdir()]) == 1
    del replay
    gc.collect()
    assert not [*tmp_path.iterdir()]


@pytest.mark.long
def test_other_detectors_see_the_recorded_images(assembly_log: Log) -> None:
    replay = Replay(assembly_log, Changes(perception="learned"))
    comparison = replay.run()
    seen = [tick.observation.bench for tick in replay.log.ticks if tick.observation.bench is not None]
    was = [tick.observation.bench for tick in assembly_log.ticks if tick.observation.bench is not None]
    assert [view.sequence for view in seen] == [view.sequence for view in was]
    assert seen != was, "images are packed, so something is seen otherwise in its last digits"
    alike = sum(bench_view.holes.keys() == other.holes.keys() for bench_view, other in zip(seen, was, strict=True))
    assert alike == len(seen)
    assert comparison.ticks > 0
    with pytest.raises(InputError, match="legal: classical, learned"):
        Replay(assembly_log, Changes(perception="none"))
