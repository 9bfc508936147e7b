"""The operator's page in a real browser: every button, every question, by mouse and by keyboard, on two widths."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cell.interfaces.faults import Action, Judgement
from cell.interfaces.operator import OperatorOrder, Question
from cell.interfaces.planning import UNKNOWN_GOAL
from tests.cell.viewing.page.rig import HELP, MEND, SURPLUS, WHERE, WHICH, PageRig

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTHS = (1280, 800)
SHOTS = os.environ.get("CELL_SCREENSHOTS")  # a folder for pictures of the page
HELD = Judgement(Action.HOLD, 0.0, (("camera_unhealthy", "the overhead image is dark"),))

pytestmark = pytest.mark.filterwarnings("ignore")  # the driver's sockets end with its process


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser is installed, so nobody has looked at the page: {', '.join(BROWSERS)}")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield opened
        opened.close()


class Visitor:
    """A browser window that looks at a rig's page.

    Attributes:
        complaints: of the browser's console, and requests that failed.
    """

    def __init__(self, browser: Any, rig: PageRig, width: int, scheme: str = "light", address: str = "") -> None:
        self.rig, self.complaints = rig, []
        self.context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page: Any = self.context.new_page()
        self.page.set_default_timeout(20_000)
        self.page.on("console", lambda line: self.complaints.append(line.text) if line.type == "error" else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(address or rig.page.address)
        self.catch_up()

    complaints: list[str]

    def catch_up(self) -> None:
        """Tick until the page shows it."""
        number = self.rig._ticks
        until_s = time.monotonic() + 20
        while int(self.page.evaluate("document.body.dataset.tick ?? -1")) < number:
            assert time.monotonic() < until_s, self.complaints
            self.rig.tick()
            time.sleep(0.11)

    def until(self, condition: str) -> None:
        """Wait for the page; its own policy forbids what the driver would do for that."""
        until_s = time.monotonic() + 10
        while not self.page.evaluate(condition):
            assert time.monotonic() < until_s, condition
            self.page.wait_for_timeout(50)

    def says(self, *orders: OperatorOrder) -> None:
        """The cell has taken just these."""
        until_s = time.monotonic() + 10
        while self.rig.said != list(orders) and time.monotonic() < until_s:
            self.page.wait_for_timeout(20)
        assert self.rig.said == list(orders)
        self.rig.said.clear()

    def answers(self, *questions: Question) -> None:
        """Every answer of these has a button, and the button says it."""
        for question in questions:
            for answer in question.answers:
                self.page.click(f'[data-number="{question.number}"] [data-value="{answer.value}"]')
                self.says(OperatorOrder("answer", answer.value, question.number))

    def shot(self, name: str) -> None:
        if SHOTS:
            Path(SHOTS).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=f"{SHOTS}/{name}.png", full_page=True)


@pytest.fixture(params=WIDTHS)
def visitor(browser: Any, request: pytest.FixtureRequest) -> Iterator[Visitor]:
    rig = PageRig()
    made = Visitor(browser, rig, request.param)
    yield made
    assert made.complaints == []
    made.context.close()
    rig.page.abandon()


BUTTONS = {
    "pauseNow": ("p", OperatorOrder("pause", "now")),
    "pausePart": ("a", OperatorOrder("pause", "after part")),
    "resume": ("r", OperatorOrder("resume")),
    "acknowledge": ("k", OperatorOrder("acknowledge")),
    "finish": ("e", OperatorOrder("finish")),
    "place": ("i", OperatorOrder("place", "o3")),
}


def test_every_button_says_its_order_by_mouse_and_by_key(visitor: Visitor) -> None:
    visitor.rig.show(questions=(HELP,))
    visitor.catch_up()
    for name, (key, order) in BUTTONS.items():
        visitor.page.click(f"#{name}")
        visitor.says(order)
        visitor.page.keyboard.press(key)
        visitor.says(order)
    visitor.page.keyboard.press("s")
    visitor.says()
    visitor.page.click("#stop")
    visitor.says(OperatorOrder("stop"))


def test_every_goal_can_be_said(visitor: Visitor) -> None:
    for goal in ("g0", "g1", "g2", UNKNOWN_GOAL):
        visitor.page.click(f'#choices [data-goal="{goal}"]')
        visitor.says(OperatorOrder("goal", goal))


def test_questions_stand_in_front_and_are_answered(visitor: Visitor) -> None:
    visitor.rig.show(questions=(HELP, WHICH))
    visitor.rig.judgement = HELD
    visitor.catch_up()
    visitor.shot(f"questions-{visitor.page.viewport_size['width']}")
    assert visitor.page.inner_text(".alarm") == "the overhead image is dark"
    help_text = visitor.page.inner_text('[data-number="1"]')
    assert HELP.reason in help_text
    assert "3 times" in help_text
    assert "Please put one into the tray" in help_text
    visitor.answers(HELP, WHICH)
    visitor.page.keyboard.press("2")
    visitor.says(OperatorOrder("answer", "placed", 1))
    visitor.rig.show(questions=())
    visitor.rig.judgement = Judgement()
    visitor.catch_up()
    assert visitor.page.query_selector_all("#front > *") == []


def test_a_hole_that_is_wrong_is_marked_as_long_as_the_question_stands(visitor: Visitor) -> None:
    visitor.rig.show(questions=(MEND,))
    visitor.catch_up()
    visitor.shot(f"mend-{visitor.page.viewport_size['width']}")
    assert "Please take it out." in visitor.page.inner_text('[data-number="3"]')
    assert visitor.page.inner_text("#holes .wrong") == "p5please look here"
    visitor.answers(MEND)
    visitor.rig.show(questions=())
    visitor.catch_up()
    assert visitor.page.query_selector_all("#holes .wrong") == []


def test_where_a_part_goes_is_asked_beside_its_holes_and_answered(visitor: Visitor) -> None:
    visitor.rig.show(questions=(WHERE, SURPLUS))
    visitor.catch_up()
    visitor.shot(f"where-{visitor.page.viewport_size['width']}")
    assert WHERE.reason in visitor.page.inner_text('[data-number="4"]')
    assert [one.inner_text() for one in visitor.page.query_selector_all("#holes .next")] == ["p3here?", "p5here?"]
    marked = [one.inner_text() for one in visitor.page.query_selector_all("#holes .wrong")]
    assert marked == [f"{name}please look here" for name in SURPLUS.positions]
    visitor.answers(WHERE, SURPLUS)
    visitor.page.keyboard.press("1")
    visitor.says(OperatorOrder("answer", "p3", 4))


def test_a_question_is_answered_in_words_of_ones_own(visitor: Visitor) -> None:
    visitor.rig.show(questions=(Question(6, "text", "which batch?"),))
    visitor.catch_up()
    visitor.page.fill('[data-number="6"] input', "Batch 7b")
    visitor.page.press('[data-number="6"] input', "Enter")
    visitor.says(OperatorOrder("answer", "Batch 7b", 6))
    visitor.page.fill('[data-number="6"] input', "stop")
    visitor.page.click('[data-number="6"] button')
    visitor.says(OperatorOrder("answer", "stop", 6))


def test_it_shows_what_the_cell_sees_believes_and_does(visitor: Visitor) -> None:
    rig = visitor.rig
    rig.tick(
        ("bracket", {"number": 3, "edge": "begin"}),
        ("belief", {"edge": ["o1", "p6"], "source": "action"}),
        ("verdict", {"subject": "o2 at p1", "decision": "act", "reason": ""}),
    )
    rig.page.message(1.0, "warning", "hold: the hand is too near")
    visitor.catch_up()
    page = visitor.page
    assert page.inner_text("#heading") == "valve bracket, shift.xml"
    assert page.inner_text("#count") == "bracket 3 of 5"
    assert page.inner_text("#action") == "hand: screw, gate valve (o1)"
    assert "gate valve (o1): placed by you" in page.inner_text("#holes")
    assert "globe valve (o2): the robot brings it next" in page.inner_text("#holes .next")
    assert re.search(r"g1\s+85 %", page.inner_text("#bars"))
    assert "moving to look" in page.inner_text("#does")
    assert "hold: the hand is too near" in page.inner_text("#lines")
    visitor.until("document.querySelector('#overlay rect')?.getAttribute('width') === '90'")
    assert page.evaluate("document.querySelectorAll('#history polyline').length") == 4
    page.uncheck("#leaf")
    rig.tick()
    visitor.catch_up()
    assert "WaitForEmptyBracket" in page.inner_text("#nodes")
    visitor.until("document.querySelector('#camera').width === 480")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    visitor.shot(f"work-{page.viewport_size['width']}")


def test_without_the_token_one_can_look_only(browser: Any) -> None:
    rig = PageRig()
    made = Visitor(browser, rig, 1280, "dark", f"http://127.0.0.1:{rig.page.port}/")
    assert "view-only" in made.page.inner_text("#said")
    assert made.page.is_disabled("#stop")
    made.page.keyboard.press("p")
    made.page.wait_for_timeout(200)
    assert rig.said == []
    made.shot("dark-look-only")
    assert made.complaints == []
    made.context.close()
    rig.page.abandon()


def test_an_order_that_makes_no_sense_now_is_told(visitor: Visitor) -> None:
    visitor.rig.show(questions=(HELP,))
    visitor.catch_up()
    visitor.rig.channel.questions = ()
    visitor.page.click('[data-number="1"] [data-value="done"]')
    visitor.until("document.querySelector('#said').textContent.includes('Not taken')")
    assert "no question 1 is asked now" in visitor.page.inner_text("#said")
    assert all("409" in line for line in visitor.complaints)
    visitor.complaints.clear()
