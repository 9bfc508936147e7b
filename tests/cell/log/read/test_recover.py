"""Damaged logs: no crash, no hang, no untyped error, no silent loss, by reader and by `log export --to recovered`."""

from __future__ import annotations

import errno
import random
import struct
import time
from pathlib import Path

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader

from bracket_cell.commands.main import main
from bracket_cell.log.read.mcap_file import McapContent, read_mcap
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.read.records import HEAD, MAGIC
from bracket_cell.log.read.salvage import Loss, recover
from bracket_cell.recording.copying import CopyingWriter
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.settings import LogSettings
from bracket_ground.errors import LogError
from tests.cell.fakes import frame
from tests.cell.recording.test_recorder import OUTCOME, record

TICKS = 8
LONGEST_S = 1.0  # of processor time


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of 8 ticks with two images."""
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    recorder = McapRecorder(path, LogSettings(), Heading({"seed": "5"}, {"a.xml": ("application/xml", b"<root/>")}))
    for number in range(TICKS):
        if number % 4 == 0:
            recorder.frame(frame(number, number * 0.04))
        recorder.tick(record(number))
    recorder.close(OUTCOME)
    return path.read_bytes()


def test_a_whole_log_is_recovered_without_loss(whole: bytes, tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    path.write_bytes(whole)
    assert not recover(path, out).lossy
    assert read_mcap(out) == read_mcap(path)
    assert main(["log", "export", "--to", "recovered", str(path)]) == 0


def test_a_cut_log_becomes_a_complete_one(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    assert not salvage(path)[0].foreign
    assert main(["log", "export", "--to", "recovered", str(path)]) == 3
    recovered = tmp_path / "log.recovered.mcap"
    with recovered.open("rb") as stream:
        official = list(make_reader(stream).iter_messages(log_time_order=False))
    assert len(official) == len(read_mcap(path).messages) > 0
    assert len(read_log(recovered).ticks) == len(read_log(path).ticks) > 0
    assert read_mcap(recovered).unfinished == ""


def test_the_first_part_stands_for_all_and_a_later_part_for_itself(
    whole: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for part, begin in ((1, 0), (2, 100)):
        recorder = McapRecorder(tmp_path / f"run.000{part}.mcap", LogSettings(), Heading({"seed": "5"}, {}))
        for number in range(TICKS):
            recorder.tick(record(begin + number))
        recorder.close(OUTCOME)
    first, later = tmp_path / "run.0001.mcap", tmp_path / "run.0002.mcap"
    assert main(["log", "export", "--to", "recovered", str(later)]) == 0
    later.write_bytes(later.read_bytes()[:-40])
    assert main(["log", "export", "--to", "recovered", str(first)]) == 3
    told = capsys.readouterr().out.splitlines()
    assert told[1:3] == [
        f"{tmp_path / 'run.recovered.0001.mcap'}: nothing is lost",
        f"{tmp_path / 'run.recovered.0002.mcap'}: lossy",
    ]
    assert read_mcap(tmp_path / "run.recovered.0001.mcap") == read_mcap(first)
    assert main(["log", "export", "--to", "recovered", str(first)]) == 2
    assert main(["log", "export", "--to", "recovered", str(first), "--overwrite"]) == 3
    (other := tmp_path / "other.mcap").write_bytes(whole)
    assert main(["log", "export", "--to", "recovered", str(first), str(other), "--overwrite"]) == 2
    assert "several logs" in capsys.readouterr().err


def test_a_full_disk_leaves_no_piece(whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    path.write_bytes(whole)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(CopyingWriter, "finish", full)
    with pytest.raises(LogError, match=r"out\.mcap: cannot be written: No space"):
        recover(path, out)
    assert list(tmp_path.iterdir()) == [path]


def test_a_damaged_chunk_costs_its_own_tick_only(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    damaged = bytearray(whole)
    damaged[chunks(whole)[TICKS // 2] + 80] ^= 0xFF  # in mid-log; the first chunk names the channels
    path.write_bytes(damaged)
    with pytest.raises(LogError):
        read_log(path)
    loss, _ = salvage(path)
    [gap] = loss.ticks_missing
    assert gap.first == gap.last
    assert loss.messages_missing["/tick"] == 1
    assert loss.bytes_skipped > 0


@pytest.mark.parametrize("length", [2**63, 2**64 - 1, 2**40])
def test_huge_lengths_are_damage(length: int, whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    at = chunks(whole)[0]
    for field_at in (at + 1, at + HEAD.size + 16):  # of the record, and of the unpacked chunk
        path.write_bytes(whole[:field_at] + struct.pack("<Q", length) + whole[field_at + 8 :])
        judge(path, read_mcap_of(whole, tmp_path))
        assert salvage(path)[0].lossy


def test_a_zip_bomb_stays_small(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    packed = zstandard.compress(bytes(2**28))
    for promised in (2**28, 100):
        body = struct.pack("<QQQII4sQ", 0, 0, promised, 0, 4, b"zstd", len(packed)) + packed
        path.write_bytes(MAGIC + struct.pack("<BQII", 1, 8, 0, 0) + struct.pack("<BQ", 6, len(body)) + body + MAGIC)
        for reader in (read_mcap, salvage):
            with pytest.raises(LogError):
                reader(path)


def test_mutants_are_never_read_short_in_silence(whole: bytes, tmp_path: Path) -> None:
    hunt(whole, tmp_path, 300)


@pytest.mark.slow
def test_ten_thousand_mutants(whole: bytes, tmp_path: Path) -> None:
    hunt(whole, tmp_path, 10_000)


def salvage(path: Path) -> tuple[Loss, McapContent]:
    """What was lost of a file, and what was brought back."""
    out = path.with_suffix(".out.mcap")
    out.unlink(missing_ok=True)
    loss = recover(path, out)
    return loss, read_mcap(out)


def chunks(whole: bytes) -> list[int]:
    """Where the chunks of a file begin."""
    found, at = [], len(MAGIC)
    while at + HEAD.size <= len(whole) - len(MAGIC):
        opcode, length = HEAD.unpack_from(whole, at)
        if opcode == Opcode.CHUNK:
            found.append(at)
        at += HEAD.size + length
    return found


def hunt(whole: bytes, folder: Path, count: int) -> None:
    original = read_mcap_of(whole, folder)
    chance = random.Random(7)
    path = folder / "mutant.mcap"
    for _ in range(count):
        path.write_bytes(mutant(whole, chance))
        judge(path, original)


def read_mcap_of(whole: bytes, folder: Path) -> McapContent:
    path = folder / "whole.mcap"
    path.write_bytes(whole)
    return read_mcap(path)


def mutant(whole: bytes, chance: random.Random) -> bytes:
    """Bits flipped, bytes overwritten, cut off, cut out, doubled or put in; lengths are the favourite victims."""
    data = bytearray(whole)
    at = chance.randrange(len(data))
    size = chance.choice((1, 2, 8, 100, 1000))
    kind = chance.randrange(6)
    if kind == 0:
        data[at] ^= 1 << chance.randrange(8)
    elif kind == 1:
        data[at : at + size] = chance.randbytes(min(size, len(data) - at))
    elif kind == 2:
        del data[at:]
    elif kind == 3:
        del data[at : at + size]
    elif kind == 4:
        data[at:at] = data[at : at + size]
    else:
        data[at:at] = chance.choice((bytes(size), b"\xff" * size, chance.randbytes(size)))
    return bytes(data)


def judge(path: Path, original: McapContent) -> None:
    """Each reader gives the original, tells of the loss, or raises a LogError, in good time."""
    for reader in (read_as_log, salvaged):
        began_s = time.process_time()
        try:
            lacks, found = reader(path)
            assert lacks or found == original, f"{reader.__name__} lost something in silence"
        except LogError:
            pass
        assert time.process_time() - began_s < LONGEST_S


def read_as_log(path: Path) -> tuple[bool, McapContent]:
    read_log(path)
    found = read_mcap(path)
    return bool(found.unfinished), found


def salvaged(path: Path) -> tuple[bool, McapContent]:
    loss, found = salvage(path)
    return loss.lossy, found
