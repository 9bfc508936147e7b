"""`cell show --html` in a real browser: the outline of a tree, and of a log the state at each of its ticks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.show import tree_at
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.log.replay.why import why_at
from bracket_cell.viewing.tree_moments import _text
from btxml.engine.tree import Tree
from btxml.views.groot2 import blackboards

pytestmark = pytest.mark.filterwarnings("ignore")  # the driver's sockets end with its process
MANY = 2500
FRAME_MS = 1000 / 60  # of a screen; what a step costs is seen in its quickest tenth where others use the processor


def entries_now(tree: Tree) -> dict[str, str]:
    """What the blackboard holds, found anew."""
    found = blackboards(tree, [scope.name or tree.name for scope in tree.scopes])
    return {f"{scope}\t{key}": _text(value) for scope, one in found.items() for key, value in one.items()}


class Reader:
    """A person with a page from a file, whose browser asks nobody."""

    def __init__(self, page: Any, file: Path) -> None:
        self.page, self.complaints = page, list[str]()
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda line: self.complaints.append(line.text) if line.type == "error" else None)
        page.on("request", lambda one: self.complaints.extend(self._foreign(one.url)))
        page.goto(file.as_uri())

    @staticmethod
    def _foreign(address: str) -> list[str]:
        return [] if address.startswith(("file:", "data:")) else [address]

    def rows(self) -> list[str]:
        return [" ".join(text.split()) for text in self.page.locator(".row").all_inner_texts()]

    def asks(self, script: str) -> Any:
        return self.page.evaluate(script)


@pytest.fixture
def opened(chromium: Callable[..., Any], tmp_path: Path) -> Iterator[Callable[..., Reader]]:
    """Opens what `cell show ARGUMENTS --html` writes."""
    browser = chromium(args=["--no-sandbox"])
    readers: list[Reader] = []

    def opens(*arguments: str | Path) -> Reader:
        page = tmp_path / "page.html"
        assert main(["show", *map(str, arguments), "--html", str(page)]) == 0
        readers.append(Reader(browser.new_page(viewport={"width": 1280, "height": 800}), page))
        return readers[-1]

    yield opens
    browser.close()
    assert [line for reader in readers for line in reader.complaints] == []


@pytest.fixture
def large(tmp_path: Path) -> Path:
    """A file with some 2,500 nodes, with text that would be HTML."""
    leaves = "".join(f'<Script name="n{k} &lt;b&gt;&lt;/script&gt;" code="x := {k}"/>' for k in range(9))
    groups = "".join(f'<Fallback name="group {k}">{leaves}</Fallback>' for k in range(MANY // 10))
    tree = f'<BehaviorTree ID="Main"><Sequence>{groups}</Sequence></BehaviorTree>'
    path = tmp_path / "large.xml"
    path.write_text(f'<root BTCPP_format="4" main_tree_to_execute="Main">{tree}</root>')
    return path


@pytest.mark.long
def test_a_large_tree_is_folded_searched_and_scrolled_smoothly(opened: Callable[..., Reader], large: Path) -> None:
    reader = opened(large)
    assert reader.asks("shown.length") == MANY + 1
    assert reader.asks("document.querySelectorAll('.row').length") < 80
    assert reader.rows()[2] == "Script n0 <b></script> code=x := 0"
    spent_ms = reader.asks(
        "() => Array.from({ length: 200 }, (_, n) => { const began = performance.now();"
        "at('tree').scrollTop = n * 270; draw(); return performance.now() - began; })"
    )
    assert sorted(spent_ms)[20] < FRAME_MS
    reader.page.click("#close")
    reader.page.wait_for_selector(".row")  # drawn with the next frame
    assert reader.rows() == [f"▸Sequence … {MANY}"]
    reader.page.click(".fold")
    assert reader.asks("shown.length") == 1 + MANY // 10
    reader.page.fill("#search", "group 249")
    assert reader.rows() == ["▾Sequence", "▾Fallback group 249"]
    assert reader.page.text_content("#found") == f"1 of {MANY + 1}"
    reader.page.press("#search", "Enter")
    assert reader.page.text_content("#node").startswith("Fallback group 249")
    reader.page.press("#search", "Escape")
    assert "▸Fallback group 249 … 9" in reader.rows()
    reader.page.press("#tree", "ArrowRight")
    reader.page.press("#tree", "ArrowDown")
    assert reader.page.text_content("#node").startswith("Script n0 <b></script>")


def test_each_subtree_stands_in_its_place(opened: Callable[..., Reader]) -> None:
    reader = opened("trees/assemble.xml")
    assert reader.asks("parts.length") == 1
    reader.page.fill("#search", "GripperIsEmpty")
    assert any(row.endswith("TidyUp") for row in reader.rows())
    assert reader.asks("parts[0].nodes.filter((n) => n[TAG] === 'TidyUp')[0][FILE]") == "assemble.xml"


@pytest.mark.long
def test_a_log_has_statuses_blackboard_and_reason_at_each_tick(
    opened: Callable[..., Reader], assembly_log: Log
) -> None:
    entries: list[dict[str, str]] = []
    replay = Replay(assembly_log)

    def watch(_: Step) -> None:
        entries.append(entries_now(replay.tree))

    replay.run(watch=watch)
    reader = opened(assembly_log.path)
    assert reader.asks("line.ticks.length") == len(assembly_log.ticks)
    count = len([tick for tick in assembly_log.ticks if tick.status == "RUNNING"])
    for tick in (count - 1, 3, count // 2, 0, count // 2 + 1):  # back and forth
        time_s = assembly_log.ticks[tick].time_s
        reader.asks(f"go({tick})")
        assert dict(enumerate(reader.asks("[...state.codes]"), 1)) == tree_at(assembly_log, time_s).statuses
        told = "Object.fromEntries(Object.entries(state.entries).map(([key, word]) => [key, words[word]]))"
        assert reader.asks(told) == entries[tick]
        why = why_at([assembly_log.path], time_s)
        assert reader.page.text_content("#why") == why["text"]
        assert reader.page.text_content("#otherwise") == why["otherwise"]
        assert f"{time_s:.2f} s" in reader.page.text_content("#clock")
    reader.page.click("#why")
    assert reader.asks("chosen") == why["tree"]["uid"] - 1
    reader.page.click("#after")
    assert reader.asks("line.ticks[now][4].some(([uid]) => uid === chosen + 1)")
    if shots := os.environ.get("CELL_SCREENSHOTS"):
        reader.page.screenshot(path=f"{shots}/tree.png")


def test_a_log_that_cannot_be_replayed_has_statuses(
    opened: Callable[..., Reader], assembly_log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bracket_cell.log.report import tree_page
    from bracket_ground.errors import LogError

    def refuses(log: Log, _: object) -> None:
        raise LogError(log.path, "was recorded with other weights")

    monkeypatch.setattr(tree_page, "Replay", refuses)
    reader = opened(assembly_log.path)
    assert "without blackboard" in reader.page.text_content("header")
    reader.asks("go(50)")
    assert (
        dict(enumerate(reader.asks("[...state.codes]"), 1))
        == tree_at(assembly_log, assembly_log.ticks[50].time_s).statuses
    )


def test_a_page_is_of_a_whole_log(assembly_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(assembly_log.path), "--at", "2", "--html", str(tmp_path / "page.html")]) == 2
    assert "--html goes with a tree file or a whole log" in capsys.readouterr().err
