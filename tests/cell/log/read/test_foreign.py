"""Files that others wrote: what the MCAP specification allows is read whole and never called damaged."""

from __future__ import annotations

import itertools
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Attachment, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from bracket_cell.commands.main import main
from bracket_cell.log.read.mcap_file import read_mcap
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.read.records import HEAD, MAGIC
from bracket_cell.log.read.salvage import recover
from bracket_ground.errors import LogError

PRIVATE_OPCODE, FUTURE_OPCODE = 0x93, 0x3C


@dataclass(frozen=True)
class Style:
    """How a file is written."""

    compression: CompressionType
    chunk_bytes: int  # 0: no chunks
    numbered: bool
    checksums: bool
    indexed: bool
    profile: str
    extra: bool

    @property
    def name(self) -> str:
        return "-".join(str(getattr(value, "name", value)) for value in vars(self).values())


PACKINGS = [(CompressionType.NONE, 0), *itertools.product(CompressionType, (1, 64, 1_000_000))]
STYLES = [
    Style(*packing, numbered, checksums, indexed, profile, extra)
    for packing in PACKINGS
    for numbered, checksums, indexed in itertools.product((True, False), repeat=3)
    for profile, extra in itertools.product(("", "ros2"), (True, False))
]


@dataclass(frozen=True)
class Content:
    """What is in a file.

    Attributes:
        topics: of its channels; messages go to one after the other.
        messages: (log time, data) in the order of writing.
    """

    name: str
    topics: tuple[str, ...]
    messages: tuple[tuple[int, bytes], ...]
    attachments: bool = True


USUAL = Content("usual", ("/a", "/b"), tuple((n, json.dumps({"number": n}).encode()) for n in range(12)))
LATEST_NS = 2**64 - 2
ODD = (
    Content("empty", (), (), attachments=False),
    Content("no messages", ("/a",), ()),
    Content("backwards", ("/a", "/b"), tuple((100 - n, b"x") for n in range(9))),
    Content("nothing in them", ("/a", "/b"), tuple((0, b"") for _ in range(9))),
    Content("end of time", ("/a",), ((0, b"x"), (LATEST_NS, b"y"))),
    Content("any topic", ("", "/", "a b", "/ä/日本", "/tick", "/observation"), tuple((n, b"{}") for n in range(12))),
    Content("large", ("/a",), ((0, bytes(200_000)), (1, b"x"))),
)
PLAIN = [style for style in STYLES if not style.extra and not style.profile and style.numbered]


def write(style: Style, content: Content = USUAL) -> bytes:
    """A file with the content, two attachments of one name and two metadata records of one name."""
    stream = BytesIO()
    writer = Writer(
        stream,
        chunk_size=style.chunk_bytes,
        compression=style.compression,
        use_chunking=style.chunk_bytes > 0,
        index_types=IndexType.ALL if style.indexed else IndexType.NONE,
        repeat_channels=style.indexed,
        repeat_schemas=style.indexed,
        use_statistics=style.indexed,
        use_summary_offsets=style.indexed,
        enable_crcs=style.checksums,
        enable_data_crcs=style.checksums,
    )
    writer.start(profile=style.profile, library="somebody")
    schema = writer.register_schema("point", "jsonschema", b"{}")
    kinds = itertools.cycle([("json", schema, {}), ("cdr", 0, {"qos": "1"})])
    channels = [writer.register_channel(topic, *next(kinds)) for topic in content.topics]
    for said in (b"one", b"two") if content.attachments else ():
        writer.add_attachment(0, 0, "note.txt", "text/plain", said)
        writer.add_metadata("facts", {"said": said.decode()})
    for number, (time_ns, data) in enumerate(content.messages):
        sequence = number // len(channels) + 7 if style.numbered else 0
        writer.add_message(channels[number % len(channels)], time_ns, data, time_ns, sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    data = stream.getvalue()
    return padded(data) if style.extra else data


def padded(data: bytes) -> bytes:
    """The same file with records that nobody knows, and bytes after the last field of known ones.

    Places in the index are no longer right then, and checksums of the whole neither: both are left out.
    """
    out = bytearray(MAGIC)
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = HEAD.unpack_from(data, at)
        body = data[at + HEAD.size : at + HEAD.size + length]
        at += HEAD.size + length
        if opcode == 0x0F:
            body = struct.pack("<I", 0)
        if opcode in (0x01, 0x03, 0x04, 0x0C):
            body += b"\0later"
        if opcode == 0x02:
            body = struct.pack("<QQI", 0, 0, 0)
        elif opcode in (0x07, 0x08, 0x0A, 0x0B, 0x0D, 0x0E):
            continue
        out += HEAD.pack(opcode, len(body)) + body
        if opcode == 0x01:
            for unknown in (PRIVATE_OPCODE, FUTURE_OPCODE):
                out += HEAD.pack(unknown, 3) + b"???"
    return bytes(out + MAGIC)


def official(data: bytes) -> tuple[list[tuple[int, bytes]], int, int]:
    """(time, data) of all messages, numbers of attachments and metadata, as the `mcap` package reads them."""
    records = list(StreamReader(BytesIO(data)).records)
    messages = [(record.log_time, record.data) for record in records if isinstance(record, Message)]
    return (
        messages,
        sum(isinstance(record, Attachment) for record in records),
        sum(isinstance(record, Metadata) for record in records),
    )


FILES = [(style, USUAL) for style in STYLES] + [
    (style, content)
    for style, content in itertools.product(PLAIN, ODD)
    if content.topics or style.chunk_bytes or not style.checksums  # there the writer's own checksum is wrong
]


def test_there_are_four_hundred_of_them() -> None:
    assert len({write(*file) for file in FILES}) >= 400


@pytest.mark.long
@pytest.mark.parametrize(("style", "content"), FILES, ids=lambda value: value.name)
def test_a_file_that_the_specification_allows_is_whole(style: Style, content: Content, tmp_path: Path) -> None:
    path, mended = tmp_path / "foreign.mcap", tmp_path / "mended.mcap"
    path.write_bytes(write(style, content))
    messages, attachments, metadata = official(path.read_bytes())
    found = read_mcap(path)
    assert [(message.time_ns, message.data) for message in found.messages] == messages
    assert (found.profile, found.unfinished, found.cropped) == (style.profile, "", {})
    assert found.attachments == ({"note.txt": b"one"} if content.attachments else {})
    with pytest.raises(LogError, match="is not a log of this program"):
        read_log(path)
    if not (messages or attachments):
        return
    assert not recover(path, mended).lossy
    again = official(mended.read_bytes())
    assert again == (messages, attachments, metadata)
    assert make_reader(BytesIO(mended.read_bytes())).get_header().profile == style.profile


@pytest.mark.parametrize("command", [["log", "info"], ["log", "query"], ["log", "ticks"], ["replay"], ["report"]])
def test_commands_say_that_it_is_no_log(command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "foreign.mcap"
    path.write_bytes(write(STYLES[0]))
    assert main([*command, str(path)]) == 2
    said = capsys.readouterr().err
    assert "is not a log of this program" in said
    assert "damaged" not in said


def tails(data: bytes) -> Iterator[bytes]:
    """The file cut at each of its records and in the middle of each."""
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        _, length = HEAD.unpack_from(data, at)
        yield data[:at]
        yield data[: at + HEAD.size + length // 2]
        at += HEAD.size + length


def test_recovery_says_that_a_file_is_foreign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "foreign.mcap"
    data = write(STYLES[0])
    profile = STYLES[0].profile
    for content, status in ((data, 0), (data[:-40], 3)):
        path.write_bytes(content)
        (tmp_path / "foreign.recovered.mcap").unlink(missing_ok=True)
        assert main(["log", "export", "--to", "recovered", str(path)]) == status
        first = capsys.readouterr().out.splitlines()[0]
        assert first.endswith(f"; this is an MCAP file with profile {profile!r}, but not a log of this program")


def test_a_foreign_file_that_was_cut_is_said_to_be_unfinished(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    for data in tails(write(STYLES[0])):
        path.write_bytes(data)
        assert read_mcap(path).unfinished


def test_another_tool_may_add_messages_without_numbers_to_a_log_of_this_program(tmp_path: Path) -> None:
    path = tmp_path / "added.mcap"
    path.write_bytes(write(replace(PLAIN[0], profile="cell", numbered=False), replace(USUAL, attachments=False)))
    assert len(read_mcap(path).messages) == len(USUAL.messages)
    assert not recover(path, tmp_path / "mended.mcap").lossy
