"""Videos: all frames are in the file, or it is said and there is none."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.recording.images import Video
from bracket_ground.errors import InputError


def noise(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (120, 160, 3), dtype=np.uint8)


def test_every_frame_is_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.mp4"
    video = Video(path, 15.0)
    for number in range(5):
        video.add(noise(number))
    assert video.close() == 5
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) == 5


def test_a_frame_of_another_size_is_refused(tmp_path: Path) -> None:
    """The encoder leaves it out without a word."""
    video = Video(tmp_path / "a.mp4", 15.0)
    video.add(noise(0))
    with pytest.raises(InputError, match="several sizes"):
        video.add(noise(0)[:60])


@pytest.mark.usefixtures("small_files")
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    """A file that no player opens was told as a video of all frames."""
    path = tmp_path / "a.mp4"
    video = Video(path, 15.0, name=tmp_path / "b.mp4")
    for number in range(30):
        video.add(noise(number))
    with pytest.raises(InputError, match=r"b.mp4: the video cannot be written completely"):
        video.close()
    assert not path.exists()


@pytest.mark.parametrize(
    ("name", "said"),
    [("/proc/a.mp4", "no file can be made in /proc: "), ("a.txt", "must end in"), ("a.avi", "must end in")],
)
def test_what_hinders_the_encoder_is_told(
    name: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"{name}: the video cannot be written: .*{said}"):
        Video(Path(name), 15.0).add(noise(0))
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""
