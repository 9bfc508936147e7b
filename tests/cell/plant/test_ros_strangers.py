"""What a stranger's nodes may tell beside what the messages mean."""

from __future__ import annotations

import math
import resource
import struct
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from bracket_cell.plant.ros_arm import Ros2Samples
from bracket_cell.plant.ros_camera import _decoded
from bracket_cell.plant.ros_services import Status


@pytest.mark.parametrize("told", [[], [0.1], [math.nan, math.nan], [0.1, math.inf]])
def test_a_column_that_the_hardware_lacks_is_not_told(told: list[float]) -> None:
    assert Ros2Samples._column(told, [1, 0]) is None


def test_a_column_is_in_the_order_of_the_joints() -> None:
    found = Ros2Samples._column([0.1, 0.2, 0.3], [2, 0])
    assert found is not None
    np.testing.assert_array_equal(found, [0.3, 0.1])


def test_a_number_that_no_status_has_is_unknown() -> None:
    assert [Status.of(number) for number in (-1, 2, 7, 99)] == [0, Status.EXECUTING, 0, 0]


def png(width: int, height: int) -> bytes:
    """A black picture, in as few bytes as that takes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    packed = zlib.compressobj(9)
    rows = b"".join(packed.compress(bytes(width + 1)) for _ in range(height)) + packed.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize("data", [b"", b"no picture", png(30_000, 20_000)[:5000], png(30_000, 20_000)])
def test_a_picture_that_none_can_be_is_refused_before_it_fills_the_memory(data: bytes) -> None:
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(OSError, match="a compressed image cannot be decoded"):
        _decoded(SimpleNamespace(data=data))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - begun < 500_000, "[kB]: .6 MB of PNG would be 5 GB"
