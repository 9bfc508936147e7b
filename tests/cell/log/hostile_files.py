"""Whole logs that lie: attachments and metadata of a short log flipped, renamed, cut, or with code beside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson
import yaml
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata
from mcap.writer import Writer

from tests.cell.log.hostile import flipped

NAMES = (
    "../outside",
    "/tmp/outside",
    "nodes/evil.py",
    "trees/" + "x" * 300 + ".xml",
    "a\x00b",
    "tree.xml/inner",
    "",
    ".",
)
EVIL = "from pathlib import Path\nPath({mark!r}).write_text('ran')\n"


@dataclass
class Contents:
    """What a log holds beside its messages."""

    attachments: list[Attachment]
    metadata: list[Metadata]
    messages: list[tuple[Any, Any, Any]] = field(repr=False)


def beginning(path: Path, ticks: int) -> Contents:
    """The first ticks of a log, with all attachments and metadata."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        attachments, metadata = list(reader.iter_attachments()), list(reader.iter_metadata())
        messages, ended = [], 0
        for message in reader.iter_messages(log_time_order=False):
            messages.append(message)
            ended += message[1].topic == "/timing"
            if ended == ticks:
                break
    return Contents(attachments, metadata, messages)


def write(path: Path, contents: Contents) -> None:
    """A log of these contents."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("cell", "cell")
        schemas: dict[int, int] = {0: 0}
        channels: dict[int, int] = {}
        for schema, channel, message in contents.messages:
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                of = schemas[channel.schema_id]
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, of, channel.metadata
                )
            at = channels[channel.id]
            writer.add_message(at, message.log_time, message.data, message.publish_time, message.sequence)
        for attachment in contents.attachments:
            writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
            )
        for record in contents.metadata:
            writer.add_metadata(record.name, record.metadata)
        writer.finish()  # type: ignore[no-untyped-call]


def lying(sound: Contents, place: int, way: str, edits: Any, mark: Path) -> Contents:
    """The same with one attachment or one metadata record that lies.

    Args:
        place: which, counted around.
        way: data, name, cut, evil or gone.
        mark: file that code of the log would write.
    """
    attachments, metadata = list(sound.attachments), list(sound.metadata)
    number = place % (len(attachments) + len(metadata))
    if number < len(attachments):
        one = attachments.pop(number)
        attachments[number:number] = _attachment(one, place, way, edits, mark)
    else:
        number -= len(attachments)
        known = metadata.pop(number)
        told = dict(known.metadata) if way == "gone" else _texts(flipped(_plain(known.metadata), edits))
        if way == "gone" and told:
            told.pop(sorted(told)[place % len(told)])
        metadata[number:number] = [] if way == "cut" else [Metadata(name=known.name, metadata=told)]
    return Contents(attachments, metadata, sound.messages)


def _attachment(one: Attachment, place: int, way: str, edits: Any, mark: Path) -> Iterator[Attachment]:
    name, data = one.name, one.data
    if way == "gone":
        return
    if way == "name":
        name = NAMES[place % len(NAMES)]
    elif way == "cut":
        data = data[: place % (len(data) + 1)]
    elif way == "evil":
        yield one
        name, data = ("nodes/evil.py", "evil.py")[place % 2], EVIL.format(mark=str(mark)).encode()
    elif name.endswith((".yaml", ".yml")):
        data = yaml.safe_dump(_simple(flipped(yaml.safe_load(data), edits)), allow_unicode=True).encode()
    elif name.endswith(".json"):
        data = orjson.dumps(flipped(orjson.loads(data), edits), option=orjson.OPT_NON_STR_KEYS, default=str)
    else:
        at = place % max(len(data), 1)
        data = data[:at] + bytes([place % 256]) + data[at + 1 :]
    yield Attachment(
        create_time=one.create_time, log_time=one.log_time, name=name, media_type=one.media_type, data=data
    )


def _plain(texts: Mapping[str, str]) -> dict[str, Any]:
    """Metadata with what is JSON in it as data."""
    found: dict[str, Any] = {}
    for name, text in texts.items():
        try:
            found[name] = orjson.loads(text)
        except orjson.JSONDecodeError:
            found[name] = text
    return found


def _texts(values: Any) -> dict[str, str]:
    """As metadata holds it: texts alone."""
    if not isinstance(values, dict):
        return {"x": str(values)}
    dumped = {
        str(name): value
        if isinstance(value, str)
        else orjson.dumps(value, option=orjson.OPT_NON_STR_KEYS, default=str).decode()
        for name, value in values.items()
    }
    return {
        name.encode("utf-8", "replace").decode(): text.encode("utf-8", "replace").decode()
        for name, text in dumped.items()
    }


def _simple(value: Any) -> Any:
    """What YAML can hold."""
    return orjson.loads(orjson.dumps(value, option=orjson.OPT_NON_STR_KEYS, default=str))
