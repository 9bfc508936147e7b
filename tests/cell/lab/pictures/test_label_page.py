"""Photographs of another program are labelled in a real browser, trained for a moment, scored and looked at."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_lab.learned.hands.data import frames_of
from bracket_lab.learned.holes.evaluate import load_plates
from bracket_lab.learned.parts.data import load_scenes
from bracket_lab.pictures.labels import LabelFolder
from bracket_lab.pictures.server import LabelServer
from bracket_lab.pictures.suggestions import Suggester
from tests.cell.lab.pictures.drawn import BENCH, CONFIGURATION, PRODUCT, Box, Drawn, photograph_plate, photograph_tray

PLATES, TRAYS = 12, 8
TYPES = list(PRODUCT.parts)

pytestmark = [
    pytest.mark.torch,
    pytest.mark.filterwarnings("ignore"),  # the driver's sockets end with its process
]


@pytest.fixture(scope="module")
def browser(chromium: Callable[..., Any]) -> Iterator[Any]:
    opened = chromium(args=["--no-sandbox"])
    yield opened
    opened.close()


class Person:
    """Somebody who labels a folder."""

    def __init__(self, browser: Any, folder: Path) -> None:
        self.server = LabelServer(
            LabelFolder(folder, PRODUCT), Suggester(BENCH, PRODUCT, CONFIGURATION.perception.model_copy())
        )
        self.thread = threading.Thread(target=self.server.serve, daemon=True)
        self.thread.start()
        self.complaints: list[str] = []
        self.page: Any = browser.new_page(viewport={"width": 1200, "height": 900})
        self.page.set_default_timeout(20_000)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(self.server.address)

    def at(self, number: int) -> dict[str, Any]:
        """Wait until a picture is shown; its labels."""
        for _ in range(400):
            if self.page.evaluate("document.body.dataset.picture") == str(number):
                return self.labels()
            self.page.wait_for_timeout(50)
        raise AssertionError((number, self.complaints, self.page.inner_text("#said")))

    def until(self, said: str) -> None:
        """Wait for a word; the page's own policy forbids what the driver would do for that."""
        for _ in range(400):
            if self.page.inner_text("#said") == said:
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(self.page.inner_text("#said"))

    def labels(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.page.evaluate("document.body.dataset.labels"))
        return found

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def drag(self, box: Box, width_px: int) -> None:
        frame = self.page.locator("#marks").bounding_box()
        scale = frame["width"] / width_px
        self.page.mouse.move(frame["x"] + box[0] * scale, frame["y"] + box[1] * scale)
        self.page.mouse.down()
        self.page.mouse.move(frame["x"] + box[2] * scale, frame["y"] + box[3] * scale)
        self.page.mouse.up()

    def close(self) -> None:
        self.page.close()
        self.server.close()
        self.thread.join(10)
        assert self.complaints == []


def label_plate(person: Person, number: int, drawn: Drawn) -> None:
    suggested = person.at(number)
    assert len(suggested["holes"]) == len(PRODUCT.positions)  # by the plate's pose
    person.press("n")
    person.press(*("0" if part is None else str(1 + TYPES.index(part)) for part in drawn.holes.values()))
    if drawn.hand is not None:
        person.drag(drawn.hand, BENCH.overhead.width_px)
        person.press("0")  # it holds nothing
    person.press("Enter")


def label_tray(person: Person, number: int, drawn: Drawn) -> None:
    for _ in person.at(number).get("parts", []):
        person.press("x")
    for name, box in drawn.parts:
        person.drag(box, BENCH.wrist.width_px)
        person.press(str(1 + TYPES.index(name)))
    person.press("Enter")


def labelled(browser: Any, folder: Path, plates: int, trays: int) -> tuple[list[Drawn], list[Drawn]]:
    """Photographs are taken, recorded, and labelled in the browser; the rows are what was drawn."""
    of_plates = [photograph_plate(folder / "plates" / f"{seed:02d}.png", seed) for seed in range(plates)]
    of_trays = [photograph_tray(folder / "trays" / f"{seed:02d}.png", seed) for seed in range(trays)]
    for camera, name, label, drawn in (
        ("overhead", "plates", label_plate, of_plates),
        ("wrist", "trays", label_tray, of_trays),
    ):
        own = folder / "own" / name
        assert main(["record", str(folder / name), "--camera", camera, "--out", str(own)]) == 0
        person = Person(browser, own)
        for number, one in enumerate(drawn):
            label(person, number, one)
        person.until("all are labelled")
        person.close()
    read = load_plates([folder / "own" / "plates"], PRODUCT)
    assert [{hole.position: hole.part for hole in plate.holes} for plate in read] == [
        plate.holes for plate in of_plates
    ]
    frames = frames_of(folder / "own" / "plates", TYPES)
    assert [len(frame.row.hands) for frame in frames] == [int(plate.hand is not None) for plate in of_plates]
    scenes = load_scenes([folder / "own" / "trays"], PRODUCT)
    types = [[part.part for part in scene.labels] for scene in scenes]
    assert types == [[name for name, _ in tray.parts] for tray in of_trays]
    return of_plates, of_trays


@pytest.mark.long
def test_what_a_person_says_on_the_page_is_what_the_rows_say(browser: Any, tmp_path: Path) -> None:
    labelled(browser, tmp_path, 2, 1)


@pytest.mark.slow
def test_photographs_are_labelled_trained_scored_and_run(
    browser: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labelled(browser, tmp_path, PLATES, TRAYS)
    for network, folder, name in (("holes", "plates", "holes_plate"), ("parts", "trays", "parts_centre")):
        data, out = str(tmp_path / "own" / folder), tmp_path / f"{name}.onnx"
        assert main(["train", network, "--data", data, "--epochs", "2", "--out", str(out)]) == 0
        assert "recommended" in capsys.readouterr().err  # after a moment
        assert main(["lab", "eval", network, "--data", data, "--weights", str(out), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        card = OnnxModel.card_of(out).scores
        measure = {"holes": "right", "parts": "map_50"}[network]
        assert card[f"pictures_{measure}"] == pytest.approx(told[measure], abs=1e-4)
        assert f"{measure}_classical" in told
    assert main(["lab", "see", str(tmp_path / "plates"), "--out", str(tmp_path / "seen")]) == 0
