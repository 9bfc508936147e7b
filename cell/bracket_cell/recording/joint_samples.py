"""The arm's joints at the rate of its own control, one protobuf message a tick: arrays that Foxglove plots.

message JointSamples { repeated double time_s = 1; JointSeries shoulder_pan = 2; ... }: a series for each joint
message JointSeries { repeated double position_rad = 1; repeated float velocity_rad_s = 2, effort_nm = 3; }
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import foxglove
import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from bracket_ground.interfaces.observation import JointSamples

TOPIC = "/joint_samples"
SERIES = ("position_rad", "velocity_rad_s", "effort_nm")
NAME = "cell.JointSamples"
ANY = tuple(f"joint_{number}" for number in range(1, 33))  # names for reading, by numbers alone
LENGTH_DELIMITED = 2  # wire type of packed arrays and messages
_Field = descriptor_pb2.FieldDescriptorProto


def schema(joints: Sequence[str]) -> foxglove.Schema:
    """Schema of the channel, for joints of these names."""
    return foxglove.Schema(name=NAME, encoding="protobuf", data=_files(tuple(joints)).SerializeToString())


def encode(samples: JointSamples) -> bytes:
    """The message; packed by hand, as its arrays lie in memory as they lie in the message."""
    count = len(samples.times_s)
    positions = np.ascontiguousarray(samples.positions_rad.T, "<f8").tobytes()
    speeds = np.ascontiguousarray(samples.velocities_rad_s.T, "<f4").tobytes()
    efforts = np.ascontiguousarray(samples.efforts_nm.T, "<f4").tobytes()
    wide, narrow = 8 * count, 4 * count
    heads = _head(1, wide), _head(2, narrow), _head(3, narrow)
    length = wide + 2 * narrow + sum(map(len, heads))
    pieces = [heads[0], samples.times_s.astype("<f8").tobytes()]
    for joint in range(samples.positions_rad.shape[1]):
        at, end = joint * narrow, (joint + 1) * narrow
        pieces += _head(joint + 2, length), heads[0], positions[2 * at : 2 * end]
        pieces += heads[1], speeds[at:end], heads[2], efforts[at:end]
    return b"".join(pieces)


def decode(data: bytes) -> JointSamples:
    """The samples of a message.

    Raises:
        google.protobuf.message.DecodeError: it is none.
    """
    found = _message_class()()
    found.ParseFromString(data)
    series = [getattr(found, joint) for joint in ANY if found.HasField(joint)]
    columns = {name: [getattr(samples, name) for samples in series] for name in SERIES}
    arrays = [np.array(columns[name], np.float64).reshape(len(series), -1).T for name in SERIES]
    return JointSamples(np.array(found.time_s, np.float64), *arrays)


@cache
def _head(number: int, length: int) -> bytes:
    """Tag and length of a field."""
    return _varint(number << 3 | LENGTH_DELIMITED) + _varint(length)


def _varint(value: int) -> bytes:
    groups = []
    while value > 0x7F:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*groups, value])


@cache
def _files(joints: tuple[str, ...]) -> descriptor_pb2.FileDescriptorSet:
    series = descriptor_pb2.DescriptorProto(name="JointSeries")
    for number, name in enumerate(SERIES, 1):
        kind = _Field.TYPE_DOUBLE if number == 1 else _Field.TYPE_FLOAT
        series.field.add(name=name, number=number, label=_Field.LABEL_REPEATED, type=kind)
    samples = descriptor_pb2.DescriptorProto(name="JointSamples")
    samples.field.add(name="time_s", number=1, label=_Field.LABEL_REPEATED, type=_Field.TYPE_DOUBLE)
    for number, joint in enumerate(joints, 2):
        kind, of = _Field.TYPE_MESSAGE, ".cell.JointSeries"
        samples.field.add(name=joint, number=number, label=_Field.LABEL_OPTIONAL, type=kind, type_name=of)
    file = descriptor_pb2.FileDescriptorProto(
        name="cell/joint_samples.proto", package="cell", syntax="proto3", message_type=[series, samples]
    )
    return descriptor_pb2.FileDescriptorSet(file=[file])


@cache
def _message_class() -> Any:
    pool = descriptor_pool.DescriptorPool()
    for file in _files(ANY).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(NAME))
