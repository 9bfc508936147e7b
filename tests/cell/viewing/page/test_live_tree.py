"""The tree of a run in a real browser, beside the page: live, with statuses, blackboard, reason and a time line."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.tree_moments import _text
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.tree import Tree
from btxml.views.groot2 import StatusBoard, blackboards
from tests.cell.viewing.page.rig import PageRig

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.filterwarnings("ignore")  # the driver's sockets end with its process
FRAME_MS, SOON_S = 1000 / 60, 20.0
SMALL = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">
  <KeepRunningUntilFailure><Sequence name="round">
    <Script name="count" code="x := x + 1; y := y > 3 ? 0 : y + 1"/>
    <ForceSuccess><ScriptCondition name="more" code="y > 1"/></ForceSuccess>
  </Sequence></KeepRunningUntilFailure>
</BehaviorTree></root>"""


def of_groups(groups: int) -> str:
    """A tree of ten nodes a group, of which one runs through all."""
    leaves = "".join(f'<Script name="n{k}" code="x := {k}"/>' for k in range(9))
    body = "".join(f'<Fallback name="group {k}">{leaves}</Fallback>' for k in range(groups))
    loop = f"<KeepRunningUntilFailure><AsyncSequence>{body}</AsyncSequence></KeepRunningUntilFailure>"
    tree = f'<BehaviorTree ID="Main">{loop}</BehaviorTree>'
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{tree}</root>'


class Looks:
    """Somebody who turned to the engineer's side of a page; a tree of the test runs behind it."""

    def __init__(self, browser: Any, path: Path, xml: str) -> None:
        self.rig = PageRig(slower=1.0)
        self.path, self.complaints = path, list[str]()
        self.runs(xml)
        self.page: Any = browser.new_page(viewport={"width": 1280, "height": 800})
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", lambda line: self.complaints.append(line.text) if line.type == "error" else None)
        self.page.goto(self.rig.page.address)
        self.tick()
        self.page.click("#toEngineer")
        self.page.wait_for_selector("#tree iframe")
        self.tree_page: Any = self.page.query_selector("#tree iframe").content_frame()
        self.catch_up()

    def runs(self, xml: str) -> None:
        """This tree takes over."""
        self.path.write_text(xml)
        self.tree: Tree = load_tree(self.path, node_registry())
        self.tree.setup(None, ManualClock())
        self.tree.blackboard.entry("x").value = 0
        self.tree.blackboard.entry("y").value = 0
        self.rig.page.watch(self.tree)
        self.statuses = StatusBoard(len(self.tree.nodes))

    def tick(self) -> int:
        self.tree.tick()
        self.statuses.update(self.tree.status_changes, 0.0)
        self.rig.takes(self.tree.status_changes)
        self.rig.tick()
        return self.rig._ticks - 1

    def asks(self, script: str) -> Any:
        return self.tree_page.evaluate(script)

    def catch_up(self) -> int:
        """Tick until the tree's page shows the newest."""
        until_s = time.monotonic() + SOON_S
        of_tree = f"typeof live !== 'undefined' && live && parts[part].nodes.length === {len(self.tree.nodes)}"
        while True:
            number = self.tick()
            self.page.wait_for_timeout(300)
            with suppress(sync_api.Error):  # of a page that is just loaded
                if self.asks(f"{of_tree} && line.ticks.at(-1)?.[1] === {number}"):
                    return number
            assert time.monotonic() < until_s, self.complaints

    def board(self) -> dict[str, str]:
        found = blackboards(self.tree, [self.tree.name])[self.tree.name]
        return {f"{self.tree.name}\t{key}": _text(value) for key, value in found.items()}


SHOWN = "Object.fromEntries(Object.entries(state.entries).map(([key, word]) => [key, words[word]]))"


@pytest.fixture
def looks(chromium: Callable[..., Any], tmp_path: Path) -> Iterator[Callable[[str], Looks]]:
    browser = chromium(args=["--no-sandbox", "--disable-3d-apis"])
    made: list[Looks] = []

    def opens(xml: str) -> Looks:
        made.append(Looks(browser, tmp_path / "tree.xml", xml))
        return made[-1]

    yield opens
    browser.close()
    for one in made:
        one.rig.page.abandon()
    assert [line for one in made for line in one.complaints] == []


@pytest.mark.long
def test_statuses_blackboard_and_reason_of_each_tick_are_there_live_and_again(looks: Callable[[str], Looks]) -> None:
    looking = looks(SMALL)
    past: dict[int, tuple[dict[str, str], dict[int, int]]] = {}
    for _ in range(20):
        number = looking.tick()
        past[number] = looking.board(), looking.statuses.codes()
    last = looking.catch_up()
    assert looking.asks("line.ticks[now][1]") == last, "it goes along"
    assert looking.asks(SHOWN) == looking.board()
    assert dict(enumerate(looking.asks("[...state.codes]"), 1)) == looking.statuses.codes()
    assert looking.tree_page.text_content("#why") == str(looking.tree.why())
    for number, (board, codes) in past.items():
        looking.asks(f"go(line.ticks.findIndex((tick) => tick[1] === {number}))")
        assert looking.asks(SHOWN) == board
        assert dict(enumerate(looking.asks("[...state.codes]"), 1)) == codes
    looking.catch_up()
    assert looking.asks("line.ticks[now][1]") == max(past), "who looks at the past is left there"


@pytest.mark.long
def test_an_edited_tree_takes_over_and_a_page_that_was_left_asks_no_more(looks: Callable[[str], Looks]) -> None:
    looking = looks(SMALL)
    looking.runs(of_groups(2))
    looking.catch_up()
    assert looking.asks("parts[part].nodes.length") == len(looking.tree.nodes)
    assert looking.asks(SHOWN) == looking.board()
    looking.page.click("#toWork")
    assert looking.page.query_selector("#tree iframe") is None


@pytest.mark.long
def test_a_run_that_says_nothing_is_told(looks: Callable[[str], Looks]) -> None:
    looking = looks(SMALL)
    looking.page.wait_for_timeout(2500)
    assert looking.tree_page.text_content("#clock").startswith("No news for ")
    looking.catch_up()
    looking.page.wait_for_timeout(300)
    assert "tick" in looking.tree_page.text_content("#clock")


def test_what_is_kept_has_an_end_and_stays_right(looks: Callable[[str], Looks]) -> None:
    looking = looks(SMALL)
    for _ in range(30):
        looking.tick()
    looking.catch_up()
    before = looking.asks(f"[line.ticks[now][1], {SHOWN}, [...state.codes]]")
    kept = looking.asks("(forget(20), line.ticks.length)")
    assert kept >= 10
    assert looking.asks(f"[line.ticks[now][1], {SHOWN}, [...state.codes]]") == before


@pytest.mark.long
def test_a_tree_of_2500_nodes_is_followed_within_a_frame(looks: Callable[[str], Looks]) -> None:
    looking = looks(of_groups(250))
    assert len(looking.tree.nodes) > 2500
    for _ in range(60):
        looking.tick()
    looking.catch_up()
    spent_ms = looking.asks(
        "(() => { const times = []; for (let tick = 1; tick < line.ticks.length; tick++) {"
        "const began = performance.now(); go(tick); times.push(performance.now() - began); } return times; })()"
    )
    assert len(spent_ms) >= 50
    assert sorted(spent_ms)[len(spent_ms) // 10] < FRAME_MS
    assert looking.asks("document.querySelectorAll('.row').length") < 120
