"""Files that others wrote: what the MCAP specification allows is read whole and never called damaged."""

from __future__ import annotations

import itertools
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Attachment, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from cell.commands.main import main
from cell.interfaces.errors import LogError
from cell.log.reading.mcap_file import read_mcap
from cell.log.reading.reader import read_log
from cell.log.reading.records import HEAD, MAGIC
from cell.log.reading.recover import recover

PRIVATE_OPCODE, FUTURE_OPCODE = 0x93, 0x3C


@dataclass(frozen=True)
class Style:
    """How a file is written."""

    compression: CompressionType
    chunking: bool
    numbered: bool
    checksums: bool
    indexed: bool
    profile: str
    extra: bool

    @property
    def name(self) -> str:
        return "-".join(str(getattr(value, "name", value)) for value in vars(self).values())


STYLES = [
    Style(*values)
    for values in itertools.product(
        CompressionType, (True, False), (True, False), (True, False), (True, False), ("", "ros2"), (True, False)
    )
]


def write(style: Style) -> bytes:
    """A file of 12 messages on two channels, two attachments of one name and two metadata records of one name."""
    stream = BytesIO()
    writer = Writer(
        stream,
        chunk_size=64,
        compression=style.compression,
        use_chunking=style.chunking,
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
    channels = [writer.register_channel("/a", "json", schema), writer.register_channel("/b", "cdr", 0, {"qos": "1"})]
    for content in (b"one", b"two"):
        writer.add_attachment(0, 0, "note.txt", "text/plain", content)
        writer.add_metadata("facts", {"said": content.decode()})
    for number in range(12):
        data = json.dumps({"number": number}).encode()
        writer.add_message(channels[number % 2], number, data, number, number // 2 + 7 if style.numbered else 0)
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
    messages = [(one.log_time, one.data) for one in records if isinstance(one, Message)]
    return (
        messages,
        sum(isinstance(one, Attachment) for one in records),
        sum(isinstance(one, Metadata) for one in records),
    )


@pytest.mark.parametrize("style", STYLES, ids=lambda style: style.name)
def test_a_file_that_the_specification_allows_is_whole(style: Style, tmp_path: Path) -> None:
    path, mended = tmp_path / "foreign.mcap", tmp_path / "mended.mcap"
    path.write_bytes(write(style))
    messages, attachments, metadata = official(path.read_bytes())
    content = read_mcap(path)
    assert [(one.time_ns, one.data) for one in content.messages] == messages
    assert (content.profile, content.unfinished, content.cropped) == (style.profile, "", {})
    assert content.attachments == {"note.txt": b"one"}
    with pytest.raises(LogError, match="is no log of this program"):
        read_log(path)
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
    assert "is no log of this program" in said
    assert "damaged" not in said


def tails(data: bytes) -> Iterator[bytes]:
    """The file cut at each of its records and in the middle of each."""
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        _, length = HEAD.unpack_from(data, at)
        yield data[:at]
        yield data[: at + HEAD.size + length // 2]
        at += HEAD.size + length


def test_a_foreign_file_that_was_cut_is_said_to_be_unfinished(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    for data in tails(write(STYLES[0])):
        path.write_bytes(data)
        assert read_mcap(path).unfinished
