"""The operator's page in a real browser: every button and question by mouse and key, one screen at every size."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.viewing.gate import Address
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.operator import OperatorOrder, Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from tests.cell.viewing.page.moments import brought_to
from tests.cell.viewing.page.rig import HELP, MEND, SURPLUS, WHERE, WHICH, PageRig, certified
from tests.docs.page_moments import GL

SIZES = ((1280, 800), (1024, 768))
EVERY_SIZE = (*SIZES, (1920, 1080), (1366, 768), (1200, 800), (800, 1280))
PHONE = (390, 844)
FINGER_PX = 44.0
ARC_MIN, FAR_MM, CAPITALS, PITCH_MM = 20.0, 2000.0, 0.72, 531.3 / 1920  # of a 24-inch screen with 1920 pixels
CONTRAST = 4.5
SHOTS = os.environ.get("CELL_SCREENSHOTS")  # a folder for pictures of the page
HELD = SafetyDecision(Action.HOLD, 0.0, (("camera_unhealthy", "the overhead image is dark"),))

pytestmark = pytest.mark.filterwarnings("ignore")  # the driver's sockets end with its process


@pytest.fixture(scope="module")
def browser(chromium: Callable[..., Any]) -> Iterator[Any]:
    """One without WebGL: the page works without its view in three dimensions, which a processor draws slowly."""
    opened = chromium(args=["--no-sandbox", "--disable-3d-apis"])
    yield opened
    opened.close()


class Visitor:
    """A browser window that looks at a rig's page.

    Attributes:
        complaints: of the browser's console, and requests that failed.
    """

    def __init__(
        self, browser: Any, rig: PageRig, size: tuple[int, int], scheme: str = "light", address: str = ""
    ) -> None:
        self.rig, self.complaints = rig, []
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
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
        until_s = time.monotonic() + 30
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
            self.page.screenshot(path=f"{SHOTS}/{name}.png", full_page=False)


@pytest.fixture(params=SIZES[1:])
def visitor(browser: Any, request: pytest.FixtureRequest) -> Iterator[Visitor]:
    rig = PageRig()
    made = Visitor(browser, rig, request.param)
    yield made
    assert made.complaints == []
    made.context.close()
    rig.page.abandon()


BUTTONS = {
    "pausePart": ("a", OperatorOrder("pause", "after part")),
    "pauseNow": ("p", OperatorOrder("pause", "now")),
    "resume": ("r", OperatorOrder("resume")),
    "place": ("i", OperatorOrder("place", "o3")),
    "finish": ("e", OperatorOrder("finish")),
}


@pytest.mark.long
@pytest.mark.parametrize("visitor", SIZES, indirect=True)
def test_every_button_says_its_order_by_mouse_or_by_key_and_none_that_would_change_nothing(visitor: Visitor) -> None:
    page, rig = visitor.page, visitor.rig
    assert page.is_disabled("#resume")
    assert page.is_disabled("#place")
    page.keyboard.press("r")
    assert page.inner_text("#said") == "Not taken: nothing is paused"
    rig.show(questions=(HELP,))
    visitor.catch_up()
    for number, (name, (key, order)) in enumerate(BUTTONS.items()):
        if number % 2:
            page.keyboard.press(key)
        else:
            page.click(f"#{name}")
        visitor.says(order)
        visitor.catch_up()
    assert page.is_disabled("#finish")
    assert page.get_attribute("#finish", "title") == "this bracket is the last one already"


def test_what_waits_for_a_person_is_acknowledged_and_then_goes_on_by_a_second_order(visitor: Visitor) -> None:
    brought_to(visitor.rig, "alarm")
    visitor.catch_up()
    visitor.page.keyboard.press("k")
    visitor.says(OperatorOrder("acknowledge"))
    visitor.rig.tick()
    visitor.rig.judgement, visitor.rig.asks = SafetyDecision(), False
    visitor.catch_up()
    visitor.page.click("#resume")
    visitor.says(OperatorOrder("resume"))


def test_stop_asks_once_more_on_the_button_itself(visitor: Visitor) -> None:
    visitor.page.keyboard.press("s")
    visitor.says()
    assert visitor.page.inner_text("#stop") == "Press again to stop"
    visitor.page.keyboard.press("s")
    visitor.says(OperatorOrder("stop"))


def test_speed_and_the_next_job_are_ordered(visitor: Visitor) -> None:
    page = visitor.page
    page.fill("#percent", "40")
    visitor.says(OperatorOrder("speed", "40"))
    page.click("#form summary")
    page.select_option("#variant", "g1")
    page.fill("#amount", "2")
    page.click("#start")
    visitor.says(OperatorOrder("job", '{"variant":"g1","amount":2}'))
    visitor.catch_up()
    assert page.inner_text("#speed output") == "40 %"
    assert page.inner_text("#orders span") == "1: 0 of 2 bracket B"


def test_an_order_is_changed_and_cancelled_and_a_late_one_says_so(visitor: Visitor) -> None:
    page, job = visitor.page, {"id": "A17", "variant": "g1", "due": "2020-01-01T08:00"}
    visitor.rig.channel.jobs.put(json.dumps(job))
    visitor.catch_up()
    assert "late: it was due" in page.inner_text("[data-order=A17]")
    page.click("[data-change=A17]")
    assert page.input_value("#orderId") == "A17"
    page.fill("#due", "")
    page.fill("#amount", "3")
    page.click("#start")
    visitor.says(OperatorOrder("job", '{"variant":"g1","amount":3,"id":"A17","due":""}'))
    visitor.catch_up()
    assert page.inner_text("[data-order=A17] span") == "A17: 0 of 3 bracket B"
    page.click("[data-cancel=A17]")
    assert visitor.rig.said == [], "it is asked once more"
    page.click("[data-cancel=A17]")
    visitor.says(OperatorOrder("job", '{"id":"A17","cancelled":true}'))
    visitor.catch_up()
    assert page.inner_text("#orders") == ""


def test_the_robots_line_says_no_tree_file_and_waits_only_where_it_waits(visitor: Visitor) -> None:
    visitor.rig.runs("PickPart")
    visitor.rig.tick(("verdict", {"decision": "wait", "reason": "o1 at p5 is not sure"}))
    visitor.catch_up()
    assert "waits because" in visitor.page.inner_text("#robot")
    assert ".xml" not in visitor.page.inner_text("#robot")
    visitor.rig.arm = replace(visitor.rig.arm, moving=True)
    visitor.catch_up()
    assert "waits" not in visitor.page.inner_text("#robot")


def test_keys_can_be_switched_off(visitor: Visitor) -> None:
    visitor.page.click("#toEngineer")
    visitor.page.uncheck("#keys")
    visitor.page.keyboard.press("p")
    visitor.page.check("#keys")
    visitor.page.evaluate("document.activeElement.blur()")
    visitor.page.keyboard.press("a")
    visitor.says(OperatorOrder("pause", "after part"))


def test_every_goal_can_be_said(visitor: Visitor) -> None:
    visitor.page.click("#toEngineer")
    visitor.catch_up()
    for goal in ("g0", "g1", "g2", UNKNOWN_GOAL):
        visitor.page.click(f'#choices [data-goal="{goal}"]')
        visitor.says(OperatorOrder("goal", goal))


def test_what_it_is_taken_for_is_denied_by_one_button(visitor: Visitor) -> None:
    visitor.rig.show(goal_belief={"g0": 0.98, "g1": 0.01, "g2": 0.01})
    visitor.catch_up()
    assert visitor.page.inner_text('#goals [data-goal="g0"]') == "taken for bracket A"
    visitor.page.click("#other")
    visitor.says(OperatorOrder("other", "g0"))


def test_questions_stand_in_front_and_are_answered(visitor: Visitor) -> None:
    visitor.rig.show(questions=(HELP, WHICH))
    visitor.rig.judgement = HELD
    visitor.catch_up()
    visitor.shot(f"questions-{visitor.page.viewport_size['width']}")
    assert visitor.page.inner_text("#words") == "Clear the view of the camera above"
    help_text = visitor.page.inner_text('[data-number="1"]')
    assert HELP.reason in help_text
    assert "3 times" in help_text
    visitor.answers(HELP, WHICH)
    visitor.page.keyboard.press("2")
    visitor.says(OperatorOrder("answer", "placed", 1))
    visitor.rig.show(questions=())
    visitor.rig.judgement = SafetyDecision()
    visitor.catch_up()
    assert visitor.page.query_selector_all("#front > *, #alarms > *") == []
    assert visitor.page.inner_text("#words") != HELP.todo


def test_a_hole_that_is_wrong_is_marked_as_long_as_the_question_stands(visitor: Visitor) -> None:
    visitor.rig.show(questions=(MEND,))
    visitor.catch_up()
    visitor.shot(f"mend-{visitor.page.viewport_size['width']}")
    assert visitor.page.inner_text("#words") == "p5: please take it out"
    assert visitor.page.inner_text("#holes .asked").startswith("! p5")
    visitor.answers(MEND)
    visitor.rig.show(questions=())
    visitor.catch_up()
    assert visitor.page.query_selector_all("#holes .asked") == []


def test_where_a_part_goes_is_asked_beside_its_holes_and_answered(visitor: Visitor) -> None:
    visitor.rig.show(questions=(WHERE, SURPLUS))
    visitor.catch_up()
    visitor.shot(f"where-{visitor.page.viewport_size['width']}")
    assert WHERE.reason in visitor.page.inner_text('[data-number="4"]')
    asked = [one.get_attribute("data-hole") for one in visitor.page.query_selector_all("#holes .asked")]
    assert asked == ["p1", "p2", "p3", "p4", "p5", "p6"]
    assert visitor.page.inner_text('#holes [data-hole="p5"]').endswith("here?")
    assert visitor.page.inner_text('#holes [data-hole="p6"]').startswith("!")
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
        ("verdict", {"part": "o2", "position": "p1", "decision": "act", "reason": ""}),
    )
    rig.page.message(1.0, "warning", "hold: the hand is too near")
    visitor.catch_up()
    page = visitor.page
    assert page.inner_text("#heading") == "valve bracket, shift.xml"
    assert page.inner_text("#count") == "bracket 3 of 5"
    assert page.inner_text("#action") == "hand: screw, gate valve"
    assert "gate valve, by you" in page.inner_text("#holes")
    assert page.inner_text("#holes .robot") == "p1globe valve: the robot brings it"
    assert page.inner_text("#robot") == "Robot: moving to look"
    visitor.until("document.querySelector('#overlay rect')?.getAttribute('width') === '90'")
    visitor.until("document.querySelector('#camera').width === 480")
    assert page.inner_text("#space h2") == "This browser shows no view in three dimensions"
    visitor.shot(f"work-{page.viewport_size['width']}")
    page.click("#toEngineer")
    visitor.catch_up()
    assert re.search(r"bracket B\s+85 %", page.inner_text("#bars"))
    assert "hold: the hand is too near" in page.inner_text("#lines")
    assert page.evaluate("document.querySelectorAll('#history polyline').length") == 4


@pytest.mark.long
def test_the_cell_is_drawn_in_three_dimensions_and_only_where_something_moved(chromium: Callable[..., Any]) -> None:
    rig = PageRig()
    opened = chromium(args=GL)
    made = Visitor(opened, rig, SIZES[0])
    drawn = "Number(document.querySelector('#view').dataset.drawn ?? 0)"
    made.until(f"{drawn} > 0")
    before = made.page.evaluate(drawn)
    made.catch_up()
    assert made.page.evaluate(drawn) <= before + 1
    assert made.complaints == []
    opened.close()
    rig.page.abandon()


FITS = "[document.documentElement.scrollHeight <= innerHeight, document.documentElement.scrollWidth <= innerWidth]"
SEEN = """() => [...document.querySelectorAll('#words, #robot, #alarms > *, #front > *, #said, #stop, #pauseNow')]
  .filter((one) => one.textContent).map((one) => one.getBoundingClientRect())
  .every((box) => box.top >= 0 && box.bottom <= innerHeight && box.right <= innerWidth)"""
LARGE = """() => [...document.querySelectorAll('#words, #robot, #stop, .question:first-child .answers button')]
  .map((one) => parseFloat(getComputedStyle(one).fontSize))"""
SMALL = f"""() => [...document.querySelectorAll('button, select, summary, input, label')]
  .filter((one) => one.checkVisibility() && one.type !== 'checkbox')
  .filter((one) => one.getBoundingClientRect().height < {FINGER_PX})
  .map((one) => one.id || one.outerHTML)"""
CUT = """() => [...document.querySelectorAll('footer button, .answers button')]
  .filter((one) => one.scrollWidth > one.clientWidth || one.scrollHeight > one.clientHeight)
  .map((one) => one.textContent)"""
PLACES = """() => [...document.querySelectorAll('footer button')].map((one) => one.getBoundingClientRect())
  .map(({ x, y, width, height }) => [x, y, width, height].map(Math.round).join())"""


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("moment", ["sure", "question", "alarm"])
def test_every_size_is_one_screen_with_words_of_20_arc_minutes(browser: Any, moment: str, language: str) -> None:
    rig = PageRig()
    brought_to(rig, moment)
    made = Visitor(browser, rig, EVERY_SIZE[0])
    made.page.select_option("#language", language)
    for width, height in EVERY_SIZE:
        made.page.set_viewport_size({"width": width, "height": height})
        made.catch_up()
        assert made.page.evaluate(CUT) == []
        made.shot(f"{moment}-{language}-{width}x{height}")
        px = min(made.page.evaluate(LARGE))
        assert math.degrees(math.atan(px * CAPITALS * PITCH_MM / FAR_MM)) * 60 >= ARC_MIN
    made.page.keyboard.press("s")
    for width, height in EVERY_SIZE:
        made.page.set_viewport_size({"width": width, "height": height})
        made.catch_up()
        assert made.page.evaluate(FITS) == [True, True]
        assert made.page.evaluate(SEEN), "sentence, question and confirmation are in view"
        assert made.page.evaluate(SMALL) == []
    made.context.close()
    rig.page.abandon()


@pytest.mark.long
def test_no_button_moves_whatever_it_says_or_the_page_shows(browser: Any) -> None:
    rig = PageRig()
    made = Visitor(browser, rig, EVERY_SIZE[0])
    for width, height in EVERY_SIZE:
        made.page.set_viewport_size({"width": width, "height": height})
        places = made.page.evaluate(PLACES)
        for change in ({"questions": (HELP, WHICH)}, {"questions": (SURPLUS,)}, {"questions": ()}):
            rig.show(**change)
            made.catch_up()
            made.page.keyboard.press("s")
            assert made.page.evaluate(PLACES) == places
    made.context.close()
    rig.page.abandon()


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "de"])
def test_a_phone_shows_one_column_and_scrolls_down_alone(browser: Any, language: str) -> None:
    rig = PageRig()
    made = Visitor(browser, rig, PHONE)
    made.page.select_option("#language", language)
    for moment in ("sure", "question", "alarm"):
        brought_to(rig, moment)
        made.catch_up()
        made.shot(f"{moment}-{language}-{PHONE[0]}x{PHONE[1]}")
        assert made.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
        assert made.page.evaluate(SMALL) == []
        assert made.page.evaluate(CUT) == []
        boxes = [made.page.query_selector(name).bounding_box() for name in ("#words", "#pauseNow", "#stop")]
        assert all(box["y"] >= 0 and box["y"] + box["height"] <= PHONE[1] for box in boxes)
    made.context.close()
    rig.page.abandon()


COLOURS = """() => {
  const clear = 'rgba(0, 0, 0, 0)';
  const says = (one) => [...one.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim());
  const behind = (one) => getComputedStyle(one).backgroundColor === clear && one.parentElement
    ? behind(one.parentElement) : getComputedStyle(one).backgroundColor;
  return [...document.querySelectorAll('body *')]
    .filter((one) => one.checkVisibility() && says(one) && !one.closest('svg, select'))
    .map((one) => [one.id || one.className || one.tagName, getComputedStyle(one).color, behind(one)]); }"""


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("moment", ["sure", "question"])
def test_every_word_has_contrast(browser: Any, scheme: str, moment: str) -> None:
    rig = PageRig()
    brought_to(rig, moment)
    made = Visitor(browser, rig, EVERY_SIZE[0], scheme)
    poor = [
        (name, round(contrast, 2))
        for name, ink, back in made.page.evaluate(COLOURS)
        if (contrast := _contrast(_rgb(ink), _rgb(back))) < CONTRAST
    ]
    assert poor == []
    made.context.close()
    rig.page.abandon()


def _rgb(text: str) -> list[float]:
    return [float(value) for value in re.findall(r"[\d.]+", text)[:3]]


def _contrast(ink: list[float], back: list[float]) -> float:
    """Of WCAG 2.2: from 1 to 21."""
    light, dark = sorted((_luminance(ink), _luminance(back)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(rgb: list[float]) -> float:
    linear = [
        value / 255 / 12.92 if value / 255 <= 0.04045 else ((value / 255 + 0.055) / 1.055) ** 2.4 for value in rgb
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_it_speaks_another_language_at_once(visitor: Visitor) -> None:
    brought_to(visitor.rig, "brings")
    visitor.catch_up()
    visitor.page.select_option("#language", "de")
    visitor.until("document.querySelector('#words').textContent.startsWith('Warte')")
    assert visitor.page.inner_text("#pauseNow") == "Pause jetzt"
    assert visitor.page.inner_text("#robot") == "Roboter: trägt Ventil"


def test_without_the_token_one_can_look_only(browser: Any) -> None:
    rig = PageRig()
    made = Visitor(browser, rig, (1280, 800), "dark", f"http://127.0.0.1:{rig.page.port}/")
    assert made.page.inner_text("#role") == "view-only"
    assert made.page.is_disabled("#stop")
    made.page.keyboard.press("p")
    made.page.wait_for_timeout(200)
    assert rig.said == []
    made.shot("dark-look-only")
    assert made.complaints == []
    made.context.close()
    rig.page.abandon()


def test_by_tls_a_tablet_that_trusts_the_certificate_operates_and_no_other(
    browser: Any, chromium: Callable[..., Any], tmp_path: Path
) -> None:
    settings, digest = certified(tmp_path, "127.0.0.2")
    rig = PageRig(settings, Address(0, "127.0.0.2"))
    trusting = chromium(args=["--no-sandbox", "--disable-3d-apis", f"--ignore-certificate-errors-spki-list={digest}"])
    try:
        assert rig.page.address.startswith("https://127.0.0.2:")
        assert not rig.page.in_clear
        visitor = Visitor(trusting, rig, SIZES[0])
        visitor.page.click("#pauseNow")
        visitor.says(OperatorOrder("pause", "now"))
        assert visitor.complaints == []
        stranger = browser.new_page()
        with pytest.raises(Exception, match="ERR_CERT_AUTHORITY_INVALID"):
            stranger.goto(rig.page.address)
        stranger.close()
    finally:
        trusting.close()
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


SILENT, HEARD = "document.body.classList.contains('silent')", "!document.body.classList.contains('silent')"
WORDS = "document.getElementById('words').textContent"


@pytest.fixture
def quick(browser: Any) -> Iterator[Visitor]:
    """A page of a run at the wall's pace, from which news come often."""
    rig = PageRig(slower=1.0)
    rig.tick()
    looks = Visitor(browser, rig, SIZES[0])
    yield looks
    looks.context.close()
    rig.page.abandon()


@pytest.mark.long
def test_old_news_look_old_and_nothing_can_be_pressed_that_would_be_lost(quick: Visitor) -> None:
    page, told = quick.page, quick.page.evaluate(WORDS)
    quick.until(SILENT)
    quick.shot("silent")
    assert re.fullmatch(r"No news for \d+ s\. Use the stop button at the cell\.", page.evaluate(WORDS))
    assert page.evaluate("getComputedStyle(document.getElementById('work')).filter") == "grayscale(1)"
    for button in page.query_selector_all("button"):
        assert button.is_disabled() or button.evaluate("node => node.closest('[inert], header') !== null")
    page.keyboard.press("p")
    assert "there is no news from the cell" in page.text_content("#said")
    assert quick.rig.said == []
    page.evaluate("window.back = 0")
    page.evaluate(f"window.watch = setInterval(() => {{ if ({HEARD}) window.back += 1 }}, 20)")
    page.wait_for_timeout(7000)  # it connects anew meanwhile, and gets the same state once more
    assert page.evaluate("window.back") == 0
    newcomer = quick.context.new_page()
    newcomer.goto(quick.rig.page.address)
    newcomer.wait_for_timeout(2000)
    assert newcomer.evaluate(SILENT)
    newcomer.close()
    quick.rig.tick()
    quick.until(HEARD)
    assert page.evaluate(WORDS) == told
    quick.rig.tick()
    page.click("#pauseNow")
    quick.says(OperatorOrder("pause", "now"))


@pytest.mark.long
def test_a_press_that_does_not_arrive_says_so_at_the_button(visitor: Visitor) -> None:
    visitor.page.route("**/order", lambda _: None)
    visitor.page.click("#pauseNow")
    visitor.until("document.getElementById('pauseNow').textContent === 'Pause now: not sent'")
    assert "it did not reach the cell" in visitor.page.text_content("#said")
    visitor.page.unroute("**/order")
    visitor.page.click("#pauseNow")
    visitor.says(OperatorOrder("pause", "now"))


@pytest.mark.long
def test_behind_a_relay_that_goes_silent_news_are_old_and_come_back_by_themselves(chromium: Callable[..., Any]) -> None:
    """As a wireless network that is gone: no end of the connection, no bytes."""
    rig = PageRig(slower=1.0)
    rig.tick()
    with Relay(rig.page.port) as relay:
        rules = f"--host-resolver-rules=MAP localhost:{rig.page.port} 127.0.0.1:{relay.port}"
        browser = chromium(args=["--no-sandbox", "--disable-3d-apis", rules])
        visitor = Visitor(browser, rig, SIZES[0], address=rig.page.address.replace("127.0.0.1", "localhost"))
        relay.silent.set()
        ticking = Ticking(rig)
        visitor.until(SILENT)
        visitor.page.wait_for_timeout(6000)  # it tries anew meanwhile
        relay.silent.clear()
        visitor.until(HEARD)
        ticking.end()
        rig.page.abandon()
        browser.close()


class Ticking(threading.Thread):
    """A run that goes on beside the test."""

    def __init__(self, rig: PageRig) -> None:
        super().__init__(daemon=True)
        self._rig, self._ended = rig, threading.Event()
        self.start()

    def run(self) -> None:
        while not self._ended.wait(0.1):
            self._rig.tick()

    def end(self) -> None:
        self._ended.set()
        self.join()


class Relay:
    """Passes bytes on both ways; silent, it takes them and passes none.

    Attributes:
        port: where it listens.
        silent: set while nothing passes.
    """

    def __init__(self, to: int) -> None:
        self.silent, self._to, self._open = threading.Event(), to, True
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]

    def __enter__(self) -> Relay:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._open = False
        self._socket.close()

    def _accept(self) -> None:
        while self._open:
            try:
                here, _ = self._socket.accept()
            except OSError:
                return
            try:
                there = socket.create_connection(("127.0.0.1", self._to))
            except OSError:  # nobody listens there now
                here.close()
                continue
            for source, sink in ((here, there), (there, here)):
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with source, suppress(OSError):
            while data := source.recv(65536):
                if not self.silent.is_set():
                    sink.sendall(data)
            sink.shutdown(socket.SHUT_RDWR)


LATE_S = 1.0  # how long after waking, or behind the cell, a sentence may be
WATCH = f"""() => {{ window.seen = [];
  setInterval(() => window.seen.push([Date.now(), {WORDS}, {SILENT}]), 20) }}"""
THIRD_GENERATION = {"offline": False, "latency": 150, "downloadThroughput": 750e3 / 8, "uploadThroughput": 250e3 / 8}


def processes() -> set[int]:
    """Browsers of this test."""
    found: dict[int, int] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            found[int(entry.parent.name)] = int(entry.read_text().rpartition(")")[2].split()[1])
    below, new = {os.getpid()}, {os.getpid()}
    while new:
        new = {child for child, parent in found.items() if parent in new}
        below |= new
    return {one for one in below if b"--closed-lid" in command_line(one) or b"--type=" in command_line(one)}


def command_line(process: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_bytes()
    return b""


@pytest.mark.long
@pytest.mark.parametrize("goes_on", [True, False])
def test_after_a_closed_lid_nothing_old_is_shown_as_new(chromium: Callable[..., Any], goes_on: bool) -> None:
    """A tablet that sleeps finds what was sent until then, and takes it for no news where the run hung meanwhile."""
    before = processes()
    browser, rig = chromium(args=["--no-sandbox", "--disable-3d-apis", "--closed-lid"]), PageRig(slower=1.0)
    rig.tick()
    visitor, ticking = Visitor(browser, rig, SIZES[0]), Ticking(rig)
    visitor.page.evaluate(WATCH)
    visitor.page.wait_for_timeout(500)
    told, asleep = visitor.page.evaluate(WORDS), processes() - before
    for process in asleep:
        os.kill(process, signal.SIGSTOP)
    time.sleep(1.0)
    rig.show(questions=(HELP,))
    time.sleep(2.0)
    if not goes_on:
        ticking.end()
        time.sleep(3.0)
    woken_ms = 1000 * time.time()
    for process in asleep:
        os.kill(process, signal.SIGCONT)
    visitor.page.wait_for_timeout(3000)
    seen = visitor.page.evaluate("window.seen")
    meanwhile = [sample for sample in seen if woken_ms - 2000 < sample[0] < woken_ms]
    assert len(meanwhile) <= 1, "it slept"  # the clock of a page that wakes may lag: its first sample is told as older
    later = [sample[1:] for sample in seen if sample[0] > woken_ms + 1000 * LATE_S]
    assert len(later) > 20
    if goes_on:
        ticking.end()
        assert told not in {words for words, _ in later}
        assert not any(silent for _, silent in later)
    else:
        assert all(silent and words.startswith("No news") for words, silent in later)
    browser.close()
    rig.page.abandon()


@pytest.mark.long
def test_a_slow_phone_says_what_is_so_now(browser: Any) -> None:
    """A sixth of this processor, a network of the third generation, and much on the page that stays as it is."""
    rig = PageRig(slower=1.0)
    for number in range(60):
        rig.page.message(float(number), "info", f"{number}: {'what was said stays in the list ' * 12}")
    rig.tick()
    phone = Visitor(browser, rig, PHONE)
    slow = phone.context.new_cdp_session(phone.page)
    slow.send("Emulation.setCPUThrottlingRate", {"rate": 6})
    slow.send("Network.enable")
    slow.send("Network.emulateNetworkConditions", THIRD_GENERATION)
    phone.page.reload()
    phone.catch_up()
    ticking, behind_s = Ticking(rig), list[float]()
    for number in range(40):
        rig.show(questions=(HELP,) if number % 20 >= 10 else ())
        time.sleep(0.25)
        tick, silent = phone.page.evaluate(f"[Number(document.body.dataset.tick), {SILENT}]")
        behind_s.append(0.1 * (rig._ticks - tick) if not silent else 0.0)
        assert not silent
    ticking.end()
    assert max(behind_s) <= LATE_S, behind_s
    phone.context.close()
    rig.page.abandon()
