"""Foxglove's protobuf messages of a log, decoded by their own schemas."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from foxglove import messages
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from cell.interfaces.errors import LogError
from cell.log.reading.mcap_file import Message

IMAGE, LINE = messages.CompressedImage, messages.Log


def decoded(path: Path, message: Message, kind: Any) -> Any:
    """A message's fields.

    Args:
        path: of the log, for errors.
        kind: class of `foxglove.messages`.

    Raises:
        LogError: the message is none of this kind.
    """
    try:
        return _message_class(kind).FromString(message.data)
    except DecodeError:
        what = f"message of {message.topic} at {message.time_ns / 1e9:.3f} s is no {kind.__name__}"
        raise LogError(path, what) from None


@cache
def _message_class(kind: Any) -> Any:
    schema = kind.get_schema()
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
