"""A replay begins at any bracket that the log still holds, with the state that stands there."""

from __future__ import annotations

import copy
import re
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.replay import Replay
from bracket_cell.recording.parts import parts_of
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_ground.errors import LogError
from tests.cell.conftest import changed_configuration

BRACKETS = 10
TREE = """<root BTCPP_format="4" main_tree_to_execute="Ten">
  <BehaviorTree ID="Ten">
    <Sequence>
      <Script code="n := 0"/>
      <Repeat num_cycles="10">
        <Sequence>
          <BeginBracket number="{n}" state="{state}"/>
          <Parallel success_count="2">
            <Sequence><Sleep msec="200"/><CountTicks least="3" note="counted"/></Sequence>
            <MoveTo pose="look"/>
          </Parallel>
          <Sleep msec="120"/>
          <EndBracket number="{n}" state="{state}"/>
        </Sequence>
      </Repeat>
    </Sequence>
  </BehaviorTree>
</root>
"""
NODES = '''
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from bracket_cell.trees.nodes.services import CellNode

class CountTicks(CellNode):
    """Counts its ticks over all brackets, and says when they are a multiple."""

    least = InputPort(int, "how many")
    note = InputPort(str, "what to say")

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._ticks, self._seen = 0, {"brackets": [1.5]}

    def update(self):
        self._ticks += 1
        if self._ticks % self.least.get():
            return Status.RUNNING
        self._seen["brackets"].append(self.now.observation.time_s)
        reason = f"{self._ticks} of {self._seen}"
        self.tools.journal.note("verdict", subject=self.note.get(), decision="act", reason=reason)
        return Status.SUCCESS
'''


@pytest.fixture(scope="module")
def shift(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten short brackets of the arm alone, a part each, of which only the last two are there; and the tree's files."""
    folder = tmp_path_factory.mktemp("shift")
    (folder / "ten.xml").write_text(TREE)
    (folder / "counting.py").write_text(NODES)
    configuration = changed_configuration(folder / "config", "\nlog:\n", "\nlog:\n  rotate_brackets: true\n")
    log = folder / "run.mcap"
    options = RunOptions(
        folder / "ten.xml", configuration, "g0", log=log, nodes=(str(folder / "counting.py"),),
        images=False, pixels=False, one_process=True,
    )  # fmt: skip
    assert run(options, Console(quiet=True)).outcome.end == "finished"
    assert len(parts_of(log)) == BRACKETS
    for part in parts_of(log)[:8]:
        part.unlink()
    return log


def changes(shift: Path, old: str = "", new: str = "") -> Changes:
    """Those nodes, and another tree where a text in it is replaced."""
    nodes = (str(shift.parent / "counting.py"),)
    if not old:
        return Changes(nodes=nodes)
    assert old in TREE
    (shift.parent / "mended.xml").write_text(TREE.replace(old, new))
    return Changes(tree=shift.parent / "mended.xml", nodes=nodes)


@pytest.mark.long
@pytest.mark.parametrize("bracket", [None, 9, 10])
def test_each_bracket_that_is_left_is_replayed_identical(shift: Path, bracket: int | None) -> None:
    log = read_log(shift)
    replay = Replay(log, changes(shift), bracket)
    comparison = replay.run()
    assert comparison.identical, comparison.first
    assert comparison.ticks == len(log.ticks) - (replay.first - log.ticks[0].number)
    assert bracket == 10 or any(tick.command is not None for tick in log.ticks[-comparison.ticks :]), "nothing moved"
    assert sum(topic == "verdict" for tick in log.ticks[-comparison.ticks :] for topic, _ in tick.notes) >= 1


def test_a_state_that_is_not_taken_up_would_be_seen(shift: Path) -> None:
    log = read_log(shift)
    state = copy.deepcopy(dict(log.ticks[0].state or {}))
    [counts] = [fields for path, _, fields in state["nodes"] if "CountTicks" in path]
    assert counts["_ticks"] == 3 * 8, "it counted through eight brackets that are gone"
    counts["_ticks"] += 1
    object.__setattr__(log.ticks[0], "state", state)
    first = Replay(log, changes(shift), 9).run().first_by_aspect["node"]
    assert "CountTicks" in first.node


def test_a_mended_tree_differs_where_its_change_acts(shift: Path) -> None:
    log = read_log(shift)
    comparison = Replay(log, changes(shift, 'least="3"', 'least="4"'), 9).run()
    first = comparison.first
    assert first is not None
    assert "CountTicks" in first.node
    assert 0 < first.tick - log.ticks[0].number < 20


def test_a_bracket_that_is_gone_is_refused_by_name(shift: Path) -> None:
    with pytest.raises(LogError, match="no beginning of bracket 3; held: 9, 10"):
        Replay(read_log(shift), changes(shift), 3)


def test_the_state_of_a_hostile_log_is_refused(shift: Path) -> None:
    log = read_log(shift)
    state = copy.deepcopy(dict(log.ticks[0].state or {}))
    [fields] = [fields for path, _, fields in state["nodes"] if "CountTicks" in path]
    seen = fields["_seen"]
    for kind in (
        "bracket_cell.recording.sink.LogSink",
        "subprocess.Popen",
        "bracket_cell.skills.motion.separation.np.testing.runstring",
    ):
        fields["_seen"] = {"n": 10**6, "record": kind, "of": {}}
        object.__setattr__(log.ticks[0], "state", state)
        with pytest.raises(LogError, match=rf"at [\d.]+ s on: .*CountTicks::\d+._seen is a {kind}, which is no part"):
            Replay(log, changes(shift), 9)
    fields["_seen"] = seen
    ticks, fields["_ticks"] = fields["_ticks"], {"n": 10**6, "list": ["24"]}
    with pytest.raises(LogError, match=r"CountTicks::\d+._ticks is list and not"):
        Replay(log, changes(shift), 9)
    fields["_ticks"] = ticks
    for name in ("execute", "update", "runtime", "children", "_x"):
        fields[name] = "text"
        with pytest.raises(LogError, match=rf"CountTicks::\d+ has no field '{name}'"):
            Replay(log, changes(shift), 9)
        del fields[name]
    state["form"] = 1
    with pytest.raises(LogError, match="of another release"):
        Replay(log, changes(shift), 9)


def test_own_nodes_are_in_the_log_and_never_run_unasked(
    shift: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(shift)]) == 2
    assert "nodes/counting.py" in capsys.readouterr().err
    other = tmp_path / "counting.py"
    other.write_text(NODES.replace("multiple", "multiple of it"))
    assert main(["replay", str(shift), "--with", str(other)]) == 0
    assert "counting.py is another one here" in capsys.readouterr().err
    assert main(["log", "export", str(shift), "--to", "btlog", "--out", str(tmp_path / "x.btlog")]) == 0
    assert main(["replay", str(shift), "--with", str(shift.parent), "--bracket", "10"]) == 0
    assert "identical" in capsys.readouterr().out


def test_a_mended_tree_is_explained_for_one_log_and_for_many(
    shift: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mended = changes(shift, 'least="3"', 'least="4"').tree
    asked = ["--tree", str(mended), "--with", str(shift.parent / "counting.py")]
    page = tmp_path / "why.html"
    assert main(["replay", str(shift), *asked, "--html", str(page)]) == 1
    told = capsys.readouterr().out
    assert "CountTicks.least: 3 -> 4" in told
    why = told[told.index("why:\n") :].splitlines()
    assert re.search(r"tick \d+, \d\.\d\d s: CountTicks: RUNNING -> SUCCESS", why[1])
    assert why[1].endswith("changed: CountTicks.least: 3 -> 4")
    assert "Sleep (mended.xml:12)" in why[2]
    assert why[2].endswith("no parameter of it was changed"), "it begins later, as CountTicks ends later"
    assert "What follows from it" in page.read_text()
    shutil.copy(parts_of(shift)[1], tmp_path / "other.mcap")
    (tmp_path / "cut.mcap").write_bytes(parts_of(shift)[1].read_bytes()[:60])
    assert main(["replay", str(shift), str(tmp_path / "other.mcap"), str(tmp_path / "cut.mcap"), *asked]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any("cut.mcap: cannot be replayed" in line for line in lines)
    assert "2 of 3 logs differ, 1 could not be replayed" in lines
