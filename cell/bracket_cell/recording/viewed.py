"""Foxglove's messages as fields that can be read: its own classes can only be written."""

from __future__ import annotations

from functools import cache
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory


@cache
def message_class(kind: Any) -> Any:
    """The class of protobuf that reads a class of `foxglove.messages`."""
    schema = kind.get_schema()
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def readable(message: Any) -> Any:
    """A message of Foxglove, to be read."""
    kind: Any = type(message)
    return message_class(kind).FromString(message.encode())
