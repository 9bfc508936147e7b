"""The layout for Foxglove and Lichtblick shows what a log holds."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from bracket_cell.log.read.reader import Log
from bracket_cell.runs.viewers import LAYOUT
from tests import ROOT
from tests.cell.viewing.viewer import topics

IN_3D = {"foxglove.SceneUpdate", "foxglove.FrameTransform", "foxglove.FrameTransforms"}
STEP = re.compile(r"\.(\w+)|\[(\d+)\]")


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    read: dict[str, Any] = json.loads(LAYOUT.read_text())
    return read


@pytest.fixture(scope="module")
def recorded(tray_log: Log) -> dict[str, str]:
    return topics(tray_log.path)


def panels(layout: dict[str, Any], kind: str) -> Iterator[dict[str, Any]]:
    return (panel for name, panel in layout["configById"].items() if name.startswith(f"{kind}!"))


def value_at(message: Any, path: str) -> Any:
    """What a message path names in a decoded message."""
    for name, index in STEP.findall(path):
        message = message[name] if name else message[int(index)]
    return message


def test_every_panel_stands_in_the_mosaic_once(layout: dict[str, Any]) -> None:
    found: list[str] = []
    waiting = [layout["layout"]]
    while waiting:
        node = waiting.pop()
        if isinstance(node, str):
            found.append(node)
        else:
            waiting += [node["first"], node["second"]]
    assert sorted(found) == sorted(layout["configById"])


def test_image_panels_have_images_calibration_and_annotations(layout: dict[str, Any], recorded: dict[str, str]) -> None:
    shown = set()
    for panel in panels(layout, "Image"):
        mode = panel["imageMode"]
        assert recorded[mode["imageTopic"]] == "foxglove.CompressedImage"
        assert recorded[mode["calibrationTopic"]] == "foxglove.CameraCalibration"
        assert all(recorded[topic] == "foxglove.ImageAnnotations" for topic in mode["annotations"])
        shown |= {mode["imageTopic"], *mode["annotations"]}
    assert shown == {t for t, s in recorded.items() if s in ("foxglove.CompressedImage", "foxglove.ImageAnnotations")}


def test_the_3d_panel_shows_all_frames_and_bodies(layout: dict[str, Any], recorded: dict[str, str]) -> None:
    [panel] = panels(layout, "3D")
    assert set(panel["topics"]) == {topic for topic, schema in recorded.items() if schema in IN_3D}


def test_the_log_panel_has_log_lines(layout: dict[str, Any], recorded: dict[str, str]) -> None:
    [panel] = panels(layout, "RosOut")
    assert recorded[panel["topicToRender"]] == "foxglove.Log"


def test_every_plotted_path_leads_to_a_value(layout: dict[str, Any], tray_log: Log) -> None:
    messages = {message.topic: json.loads(message.data) for message in tray_log.messages if message.encoding == "json"}
    for panel in (*panels(layout, "Plot"), *panels(layout, "StateTransitions")):
        for series in panel["paths"]:
            topic = max((topic for topic in messages if series["value"].startswith(f"{topic}.")), key=len)
            assert value_at(messages[topic], series["value"].removeprefix(topic)) is not None, series["value"]
            assert series["enabled"]
    for panel in panels(layout, "RawMessages"):
        assert panel["topicPath"] in messages


def test_the_command_names_the_file() -> None:
    assert LAYOUT == ROOT / "cell" / "bracket_cell" / "config" / "foxglove_layout.json"
