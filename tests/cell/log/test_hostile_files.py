"""Whatever attachments and metadata of a log say: each command ends in a line, and nothing of the log runs."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import orjson
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from mcap.records import Attachment

from bracket_cell.commands.main import main
from bracket_cell.log.read.frames import LoggedFrame
from bracket_cell.log.replay.logged_tree import CONFIGURATION, PRODUCT
from bracket_ground.errors import LogError
from tests.cell.log.hostile import EDITS, enormous
from tests.cell.log.hostile_files import NAMES, Contents, beginning, lying, write

CASE = Path(__file__).parents[2] / "cases" / "assembly-g0-seed5.mcap"
TICKS = 21
MANY = int(os.environ.get("HOSTILE_LOGS", "1500"))
OF_A_LIBRARY = re.compile(r"\b\w+Error\b|pydantic|input_value|/tmp/cell-")
WAYS = ("data", "name", "cut", "evil", "gone")
LOG, FOLDER, SOUND = "LOG", "FOLDER", "SOUND"
COMMANDS = (
    ("log", "info", LOG),
    ("log", "why", LOG),
    ("log", "ticks", "--all", LOG),
    ("log", "info", LOG, "--nodes"),
    ("log", "query", "--key", "x", LOG),
    ("log", "diff", LOG, SOUND),
    ("log", "list", FOLDER),
    ("log", "export", LOG, "--to", "csv", "--out", "made/csv"),
    ("log", "export", LOG, "--to", "training", "--out", "made/training"),
    ("log", "export", LOG, "--to", "rosbag2", "--out", "made/bag"),
    ("log", "export", LOG, "--to", "btlog", "--out", "made/run.btlog"),
    ("lab", "files", LOG, "--out", "made/files"),
    ("log", "export", LOG, "--to", "recovered", "--out", "made/recovered.mcap"),
    ("log", "to-test", LOG, "-o", "made"),
    ("report", LOG, "--out", "made/report.html"),
    ("replay", LOG),
    ("show", LOG),
)


class Folder:
    """A folder with a sound log and one that lies, in which commands are called."""

    def __init__(self, path: Path, sound: Contents) -> None:
        self.sound, self.log, self.mark = sound, path / "logs" / "run.mcap", path / "mark"
        self._made, self._beside = path / "made", path / "sound.mcap"
        self.log.parent.mkdir()
        write(self._beside, sound)

    def call(self, command: tuple[str, ...]) -> int:
        """Its status; what it made is removed."""
        places = {LOG: self.log, FOLDER: self.log.parent, SOUND: self._beside}
        self._made.mkdir(exist_ok=True)
        try:
            return main([str(places.get(word, word)) for word in command])
        finally:
            shutil.rmtree(self._made)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    monkeypatch.chdir(tmp_path)
    return Folder(tmp_path, beginning(CASE, TICKS))


def try_files(folder: Folder, examples: int) -> None:
    """Every command in turn, with every way to lie and every part of the log; the edits are drawn."""
    statuses, turns = {0: 0, 1: 0, 2: 0, 3: 0}, count(1)

    @settings(
        max_examples=examples,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        database=None,
        phases=(Phase.explicit, Phase.generate),
    )
    @given(edits=EDITS)
    def tried(edits: Any) -> None:
        turn = next(turns)
        command, way = COMMANDS[turn % len(COMMANDS)], WAYS[(turn + turn // len(COMMANDS)) % len(WAYS)]
        write(folder.log, lying(folder.sound, 7919 * turn, way, edits, folder.mark))
        statuses[folder.call(command)] += 1
        assert not folder.mark.exists(), "code of the log ran"

    tried()
    assert sum(statuses.values()) >= examples
    assert statuses[0] > examples // 4, statuses
    assert statuses[1] + statuses[2] > 0, statuses  # a replay of a log that was cut differs, or is refused


@pytest.mark.long
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: "-".join(command[:2]))
def test_the_sound_beginning_is_taken(folder: Folder, command: tuple[str, ...]) -> None:
    """Else the tests below would try nothing. A replay differs at the end, as the log was cut; a case has no why."""
    write(folder.log, folder.sound)
    expected = {("replay",): 1, ("log", "why"): 2}
    assert folder.call(command) == expected.get(command[:2], expected.get(command[:1], 0))


@pytest.mark.parametrize("uid", [-1, 0, 9999])
def test_a_change_of_no_node_of_the_tree_is_told(uid: int, folder: Folder, capsys: pytest.CaptureFixture[str]) -> None:
    place = next(at for at, (_, channel, _) in enumerate(folder.sound.messages) if channel.topic == "/tick")
    schema, channel, message = folder.sound.messages[place]
    fields = orjson.loads(message.data)
    fields["changes"][0]["uid"] = uid
    folder.sound.messages[place] = schema, channel, replace(message, data=orjson.dumps(fields))
    write(folder.log, folder.sound)
    assert folder.call(("log", "export", LOG, "--to", "btlog", "--out", "made/run.btlog")) == 2
    assert f"tick {fields['tick']} is of a node or a time that no run has" in capsys.readouterr().err


def test_an_enormous_image_is_told() -> None:
    with pytest.raises(LogError, match=r"camera overhead at 1\.000 s cannot be decoded"):
        LoggedFrame(Path("run.mcap"), "overhead", 1.0, enormous()).image()


@pytest.mark.parametrize("name", NAMES)
def test_an_attachment_of_any_name_ends_in_a_line(
    folder: Folder, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    beside = folder.sound.attachments[0]
    named = Attachment(beside.create_time, beside.log_time, name, beside.media_type, beside.data)
    write(folder.log, Contents([*folder.sound.attachments, named], folder.sound.metadata, folder.sound.messages))
    assert folder.call(("replay", LOG)) in (1, 2)  # a file beside that nothing reads is harmless
    *_, last = capsys.readouterr().err.strip().splitlines()
    assert last.startswith(("cell: ", "identical", "differs"))


@pytest.mark.parametrize("text", [b"product: " + b"[" * 50_000 + b"]" * 50_000, b"- 1\n", b"", bytes(range(256))])
def test_a_file_of_the_log_is_told_by_the_logs_name(
    folder: Folder, text: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = [
        Attachment(one.create_time, one.log_time, one.name, one.media_type, text) if one.name == CONFIGURATION else one
        for one in folder.sound.attachments
    ]
    write(folder.log, Contents(changed, folder.sound.metadata, folder.sound.messages))
    assert folder.call(("replay", LOG)) == 2
    assert capsys.readouterr().err.strip().splitlines()[-1].startswith(f"cell: {folder.log}: {CONFIGURATION}:")


@pytest.mark.long
@pytest.mark.parametrize("name", [CONFIGURATION, PRODUCT, "faults.yaml", "tree/assemble.xml"])
@pytest.mark.parametrize("text", [b"[" * 50_000, b"- 1\n", b"", b"\xff", b"{a: {b: [1, x]}}"])
def test_a_file_of_the_log_is_told_in_words(
    folder: Folder, name: str, text: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = [
        Attachment(one.create_time, one.log_time, one.name, one.media_type, text) if one.name == name else one
        for one in folder.sound.attachments
    ]
    assert changed != folder.sound.attachments
    for command in COMMANDS:
        write(folder.log, Contents(changed, folder.sound.metadata, folder.sound.messages))
        assert folder.call(command) in (0, 1, 2, 3)
        told = capsys.readouterr().err
        assert not OF_A_LIBRARY.search(told), (command, told)


@pytest.mark.long
def test_files_that_lie_are_refused_or_harmless(folder: Folder) -> None:
    try_files(folder, 2 * len(COMMANDS))


@pytest.mark.slow
def test_many_files_that_lie_are_refused_or_harmless(folder: Folder) -> None:
    try_files(folder, MANY)
