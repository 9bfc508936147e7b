"""What the end of an MCAP file tells at once, without the index of its chunks."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Footer, MetadataIndex, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader

FOOTER_BYTES = 9 + 20 + 8  # head, content, magic at the end of the file


def statistics(path: Path) -> Statistics | None:
    """How many messages a file has, and from when to when; None where it does not say."""
    return next((one for one in _group(path, Opcode.STATISTICS) if isinstance(one, Statistics)), None)


def metadata_names(path: Path) -> set[str]:
    """Names of the metadata in a file; empty where it does not say."""
    return {one.name for one in _group(path, Opcode.METADATA_INDEX) if isinstance(one, MetadataIndex)}


def _group(path: Path, opcode: int) -> Iterator[Any]:
    """Records of one kind, found by the offsets at the end of the file."""
    try:
        with path.open("rb") as stream:
            stream.seek(-FOOTER_BYTES, io.SEEK_END)
            footer = next(StreamReader(stream, skip_magic=True).records)
            if not isinstance(footer, Footer) or not footer.summary_offset_start:
                return
            stream.seek(footer.summary_offset_start)
            for offset in StreamReader(stream, skip_magic=True).records:
                if isinstance(offset, SummaryOffset) and offset.group_opcode == opcode:
                    stream.seek(offset.group_start)
                    group = io.BytesIO(stream.read(min(offset.group_length, path.stat().st_size)))
                    yield from StreamReader(group, skip_magic=True).records
                    return
    except (McapError, struct.error, ValueError, OSError, StopIteration):
        return
