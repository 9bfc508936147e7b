"""Logs as a LeRobotDataset v3: an episode for each log, or each stretch of it without a gap, and the images as video.

The format is that of Hugging Face's LeRobot (https://huggingface.co/docs/lerobot/lerobot-dataset-v3). A row has what
the arm measured and what was commanded then: the joints that the followed trajectory asks for one row later, and the
gripper's goal.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.learned.inference.policy import ENVIRONMENT, OF_ENVIRONMENT, of_state
from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log
from bracket_cell.log.training.episodes import Episode, episodes_of, image_times_s, rate_hz_of
from bracket_cell.packages import needed
from bracket_ground.errors import InputError, words_of
from bracket_ground.files.files import whole_or_none
from bracket_ground.interfaces.pose import Array

VERSION, CHUNK, SUCCESS = "v3.0", 1000, "next.success"
CAMERAS = ("overhead", "wrist")
AXES = ("height", "width", "channels")
PIXELS_EVERY = 10  # frames between two whose pixels count for the statistics
CODEC, ENCODER = "h264", "libx264"
PATHS = "chunk-{chunk_index:03d}/file-{file_index:03d}"


class FilmedVideo:
    """An MP4 file in a codec that browsers play, by FFmpeg; all frames have the size of the first one."""

    def __init__(self, path: Path, rate_hz: float) -> None:
        av = needed("av", "a video in H.264 or AV1", "parquet")
        path.parent.mkdir(parents=True, exist_ok=True)
        self._av, self._file = av, av.open(str(path), "w")
        self._stream = self._file.add_stream(ENCODER, rate=round(rate_hz))
        self._size = (0, 0)

    def add(self, bgr: Any) -> None:
        """One more frame.

        Raises:
            InputError: it has another size.
        """
        size = (bgr.shape[1], bgr.shape[0])
        if self._size == (0, 0):
            self._size = self._stream.width, self._stream.height = size
            self._stream.pix_fmt = _pixels(size)
        if size != self._size:
            raise InputError("frames of several sizes do not go into one video")
        self._put(self._stream.encode(self._av.VideoFrame.from_ndarray(bgr, format="bgr24")))

    def close(self) -> None:
        """Write what is left."""
        self._put(self._stream.encode())
        self._file.close()

    def _put(self, packets: Any) -> None:
        for packet in packets:
            self._file.mux(packet)


def write_lerobot(logs: Sequence[Log], folder: Path) -> int:
    """Write a data set; returns how many rows it has.

    Args:

    Raises:
        InputError: the folder is there already or cannot be written, or pyarrow is missing.
        LogError: a log has no tick, or fewer than two overhead images where others have some.
    """
    if folder.exists():
        raise InputError(f"{folder}: exists already; name a new folder")
    _arrow()  # before anything is written
    filmed = any(map(image_times_s, logs))
    rates = {max(1, round(rate_hz_of(log, filmed=filmed))) for log in logs}
    if len(rates) > 1:
        raise InputError(f"the logs have images at {sorted(rates)} a second; a data set has one rate")
    rate_hz = rates.pop()
    try:
        with whole_or_none(folder) as partial:
            episodes, sizes = list[Episode](), dict[str, tuple[int, int]]()
            cameras = [camera for camera in CAMERAS if filmed and all(Frames(log).times_s(camera) for log in logs)]
            for log, episode in ((each, episode) for each in logs for episode in episodes_of(each, rate_hz)):
                for camera in cameras:
                    video = FilmedVideo(partial / "videos" / _video(camera) / _file(len(episodes), ".mp4"), rate_hz)
                    sizes[camera] = _write_video(log, camera, episode, video)
                episodes.append(episode)
            _write_tables(episodes, rate_hz, partial)
            _write_json(_info(episodes, rate_hz, sizes), partial / "meta" / "info.json")
            _write_json(_statistics(episodes, rate_hz), partial / "meta" / "stats.json")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {words_of(error)}") from None
    return sum(len(episode.times_s) for episode in episodes)


def _pixels(size: tuple[int, int]) -> str:
    """Colours of two rows and columns together, as every player has it; of an odd size each has its own."""
    return "yuv444p" if size[0] % 2 or size[1] % 2 else "yuv420p"


def _video(camera: str) -> str:
    return f"observation.images.{camera}"


def _write_video(log: Log, camera: str, episode: Episode, video: FilmedVideo) -> tuple[int, int]:
    """One frame a row, before the first one of a camera that first; returns (height, width)."""
    frames, size, pixels = Frames(log), (0, 0), episode.pixels.setdefault(camera, [])
    first_s, image, shown_s = frames.times_s(camera)[0], None, -1.0
    for row, time_s in enumerate(episode.times_s):
        frame = frames.newest_of(camera, max(float(time_s), first_s))
        assert frame is not None, "it has one from its first time on"
        if image is None or frame.time_s != shown_s:
            image, shown_s = frame.image(), frame.time_s
        size = image.shape[0], image.shape[1]
        video.add(image)
        if row % PIXELS_EVERY == 0:
            pixels.append(np.asarray(image[::4, ::4, ::-1], np.float64).reshape(-1, 3) / 255.0)
    video.close()
    return size


def _write_tables(episodes: Sequence[Episode], rate_hz: float, folder: Path) -> None:
    arrow, parquet = _arrow()
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    first, about = 0, []
    for number, episode in enumerate(episodes):
        count = len(episode.times_s)
        target = folder / "data" / _file(number, ".parquet")
        target.parent.mkdir(parents=True, exist_ok=True)
        rows = _rows(arrow, episode, number, first, tasks.index(episode.task), rate_hz)
        parquet.write_table(rows if _judged(episodes) else rows.drop_columns([SUCCESS]), target)
        place = {"chunk_index": number // CHUNK, "file_index": number % CHUNK}
        video = {**place, "from_timestamp": 0.0, "to_timestamp": count / rate_hz}
        about.append(
            {
                "episode_index": number,
                "tasks": [episode.task],
                "length": count,
                "dataset_from_index": first,
                "dataset_to_index": first + count,
                **{f"data/{name}": value for name, value in place.items()},
                **{
                    f"videos/{_video(pixel)}/{name}": value for pixel in episode.pixels for name, value in video.items()
                },
                **{f"meta/episodes/{name}": 0 for name in place},
                **_of_episode(episode, rate_hz),
            }
        )
        first += count
    target = folder / "meta" / "episodes" / _file(0, ".parquet")
    target.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(arrow.Table.from_pylist(about), target)
    parquet.write_table(_task_table(arrow, tasks), folder / "meta" / "tasks.parquet")


def _rows(arrow: Any, episode: Episode, number: int, first: int, task: int, rate_hz: float) -> Any:
    count = len(episode.times_s)
    last = np.arange(count) == count - 1
    vectors = arrow.list_(arrow.float32(), episode.states.shape[1])
    columns = {
        "observation.state": arrow.array(list(episode.states.astype(np.float32)), vectors),
        ENVIRONMENT: arrow.array(list(episode.parts_m.astype(np.float32)), arrow.list_(arrow.float32(), 3)),
        "action": arrow.array(list(episode.actions.astype(np.float32)), vectors),
        "next.done": arrow.array(last & episode.ended, arrow.bool_()),
        SUCCESS: arrow.array([*([False] * (count - 1)), episode.success], arrow.bool_()),
        "timestamp": arrow.array((np.arange(count) / rate_hz).astype(np.float32)),
        "frame_index": arrow.array(np.arange(count, dtype=np.int64)),
        "episode_index": arrow.array(np.full(count, number, np.int64)),
        "index": arrow.array(np.arange(first, first + count, dtype=np.int64)),
        "task_index": arrow.array(np.full(count, task, np.int64)),
    }
    return arrow.table(columns)


def _judged(episodes: Sequence[Episode]) -> bool:
    """Whether each is known to be a success or none: trainers read no column that says nothing of one."""
    return all(episode.success is not None for episode in episodes)


def _task_table(arrow: Any, tasks: Sequence[str]) -> Any:
    """Numbers of tasks; their words are the index of the pandas table that readers expect."""
    index = "__index_level_0__"
    number = {"pandas_type": "int64", "numpy_type": "int64", "metadata": None}
    words = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    pandas = {
        "index_columns": [index],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", **number},
            {"name": None, "field_name": index, **words},
        ],
        "pandas_version": "2.0.0",
    }
    table = arrow.table({"task_index": arrow.array(range(len(tasks)), arrow.int64()), index: list(tasks)})
    return table.replace_schema_metadata({b"pandas": json.dumps(pandas).encode()})


def _info(episodes: Sequence[Episode], rate_hz: float, sizes: Mapping[str, tuple[int, int]]) -> dict[str, Any]:
    names = of_state(episodes[0].joints)
    vector = {"dtype": "float32", "shape": [len(names)], "names": list(names)}
    videos = {_video(camera): _about_video(size, rate_hz) for camera, size in sizes.items()}
    flag, whole = {"dtype": "bool", "shape": [1], "names": None}, {"dtype": "int64", "shape": [1], "names": None}
    return {
        "codebase_version": VERSION,
        "robot_type": f"arm of {len(episodes[0].joints)} joints",
        "total_episodes": len(episodes),
        "total_frames": sum(len(episode.times_s) for episode in episodes),
        "total_tasks": len({episode.task for episode in episodes}),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate_hz,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{PATHS}.parquet",
        "video_path": f"videos/{{video_key}}/{PATHS}.mp4",
        "features": {
            "observation.state": vector,
            ENVIRONMENT: {**vector, "shape": [len(OF_ENVIRONMENT)], "names": list(OF_ENVIRONMENT)},
            "action": vector,
            **videos,
            "next.done": flag,
            **({SUCCESS: flag} if _judged(episodes) else {}),
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), whole),
        },
    }


def _about_video(size: tuple[int, int], rate_hz: float) -> dict[str, Any]:
    video = {
        "video.height": size[0],
        "video.width": size[1],
        "video.codec": CODEC,
        "video.pix_fmt": _pixels(size),
        "video.is_depth_map": False,
        "video.fps": rate_hz,
        "video.channels": 3,
        "has_audio": False,
    }
    return {"dtype": "video", "shape": [*size, 3], "names": list(AXES), "info": video}


def _statistics(episodes: Sequence[Episode], rate_hz: float) -> dict[str, Any]:
    """By which training normalises: least, largest, mean and spread of each column, of pixels by channel."""
    lengths = [len(episode.times_s) for episode in episodes]
    times_s = np.concatenate([np.arange(length) / rate_hz for length in lengths])
    features: dict[str, dict[str, Any]] = {
        "observation.state": _spread(np.concatenate([episode.states for episode in episodes])),
        ENVIRONMENT: _spread(np.concatenate([episode.parts_m for episode in episodes])),
        "action": _spread(np.concatenate([episode.actions for episode in episodes])),
        "timestamp": _spread(times_s[:, np.newaxis]),
    }
    for camera in episodes[0].pixels:
        pixels = [rows for episode in episodes for rows in episode.pixels[camera]]
        spread = _spread(np.concatenate(pixels))
        image = {name: [[[value]] for value in values] for name, values in spread.items() if name != "count"}
        features[_video(camera)] = {**image, "count": [len(pixels)]}
    return features


def _of_episode(episode: Episode, rate_hz: float) -> dict[str, Any]:
    """The statistics of one episode, as columns of its row."""
    found = _statistics([episode], rate_hz)
    return {f"stats/{name}/{key}": value for name, inner in found.items() for key, value in inner.items()}


def _spread(values: Array) -> dict[str, list[float]]:
    return {
        "min": values.min(axis=0).tolist(),
        "max": values.max(axis=0).tolist(),
        "mean": values.mean(axis=0).tolist(),
        "std": values.std(axis=0).tolist(),
        "count": [len(values)],
    }


def _file(number: int, ending: str) -> str:
    return PATHS.format(chunk_index=number // CHUNK, file_index=number % CHUNK) + ending


def _write_json(content: dict[str, Any], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2), encoding="utf-8")


def _arrow() -> tuple[Any, Any]:
    return needed("pyarrow", "a data set", "parquet"), needed("pyarrow.parquet", "a data set", "parquet")
