"""Salvage of truncated and damaged logs: a complete file of all that is right in one, and what was lost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from cell.interfaces.errors import LogError
from cell.log.reading.mcap_file import PROFILE
from cell.log.reading.recovered import Loss, Salvage
from cell.log.reading.salvage import salvage

CHUNK_BYTES = 64 * 1024


def recover(path: Path, out: Path) -> Loss:
    """Write what can be salvaged of a log as a complete file.

    Raises:
        LogError: the log cannot be read, holds nothing of an MCAP file, or the new file cannot be written.
    """
    found = salvage(path)
    try:
        with out.open("xb") as stream:
            _write(found, stream)
    except FileExistsError:
        raise LogError(out, "exists already; choose another file by --out") from None
    except OSError as error:
        raise LogError(out, f"cannot be written: {error.strerror or error}") from None
    return found.loss


def _write(found: Salvage, stream: Any) -> None:
    """A complete file; messages of own logs are numbered anew, the loss stands in the metadata `recovered`."""
    writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile=found.profile, library="cell log recover")
    for one in found.attachments:
        writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
    for record in found.metadata:
        writer.add_metadata(record.name, record.metadata)
    if found.loss.lossy:
        writer.add_metadata("recovered", {name: json.dumps(value) for name, value in vars(found.loss).items()})
    schemas = {key: writer.register_schema(one.name, one.encoding, one.data) for key, one in found.schemas.items()}
    channels = {
        number: writer.register_channel(one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata)
        for number, one in found.channels.items()
    }
    own = found.profile == PROFILE
    sequences: dict[int, int] = {}
    for message in found.messages:
        channel = channels[message.channel]
        sequences[channel] = sequences.get(channel, 0) + 1
        number = sequences[channel] if own else message.sequence
        writer.add_message(channel, message.time_ns, message.data, message.published_ns, number)
    writer.finish()  # type: ignore[no-untyped-call]
