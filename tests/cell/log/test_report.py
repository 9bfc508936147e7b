"""The report: whole, self-contained, and shown by a browser without an error."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from cell.interfaces.errors import InputError, LogError
from cell.log.reader import Log
from cell.log.report import report_html, write_report
from cell.log.story import beliefs, node_rows, verdicts

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
VOID = {"meta", "link", "br", "img", "hr", "input"}


class Outline(HTMLParser):
    """Checks that tags close in order, and keeps ids, addresses and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.ids += [values["id"] or ""] if "id" in values else []
        self.addresses += [value or "" for name, value in attrs if name in ("href", "src", "xlink:href", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


@pytest.fixture(scope="module")
def page(assembly_log: Log) -> str:
    return report_html(assembly_log)


@pytest.fixture(scope="module")
def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    return parsed


def test_page_is_well_formed_and_has_all_sections(outline: Outline) -> None:
    assert outline.open == []
    assert {"timeline", "belief", "placements", "verdicts", "waits", "timing", "frames"} <= set(outline.ids)


def test_page_needs_no_network(page: str, outline: Outline) -> None:
    assert outline.addresses
    assert all(address.startswith("data:") for address in outline.addresses)
    assert not re.search(
        r"(?:https?:)?//[a-z]|@import|url\(|<script", page.replace("data:image/jpeg;base64,", "")[:9000]
    )


def test_every_belief_and_verdict_is_told(assembly_log: Log, outline: Outline) -> None:
    text = " ".join(outline.text)
    assert beliefs(assembly_log)
    assert verdicts(assembly_log)
    for belief in beliefs(assembly_log):
        assert all(f"{value:.4f}" in text for value in belief.goals.values())
    assert all(verdict.reason in text for verdict in verdicts(assembly_log))


def test_rows_are_leaves_that_ran_and_runs_do_not_overlap(assembly_log: Log) -> None:
    rows = node_rows(assembly_log)
    assert {"ActivateGripper", "DetectAction", "WaitForAction"} <= {row.name for row in rows}
    assert not any(row.name == "Sequence" for row in rows)
    for row in rows:
        times = [time for run in row.runs for time in (run.begin_s, run.end_s)]
        assert times == sorted(times)


def test_key_frames_are_embedded(page: str) -> None:
    assert page.count("data:image/jpeg;base64,/9j/") >= 3


def test_words_of_a_log_are_no_markup(assembly_log: Log) -> None:
    evil = replace(assembly_log, outcome={"end": "failed", "reason": "<script>alert(1)</script>"})
    assert "<script>" not in report_html(evil)


def test_log_without_frames_and_one_cut_off_are_told(assembly_log: Log) -> None:
    bare = replace(assembly_log, messages=(), outcome={}, unfinished="was not closed", ticks=assembly_log.ticks[:40])
    page = report_html(bare)
    assert "no camera frames" in page
    assert "cut off" in page


def test_nothing_to_tell_and_nowhere_to_write_are_typed_errors(assembly_log: Log, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no tick"):
        report_html(replace(assembly_log, ticks=()))
    with pytest.raises(InputError, match="cannot be written"):
        write_report(assembly_log, tmp_path / "nowhere" / "report.html")


@pytest.mark.slow
def test_browser_shows_it_without_an_error(assembly_log: Log, tmp_path: Path) -> None:
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        pytest.skip(f"no browser is installed: {', '.join(BROWSERS)}")
    page, picture = tmp_path / "report.html", tmp_path / "report.png"
    write_report(assembly_log, page)
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    options += [f"--user-data-dir={tmp_path / 'browser'}", "--enable-logging=stderr", "--window-size=1280,3000"]
    command = [browser, *options, f"--screenshot={picture}", page.as_uri()]
    told = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "CONSOLE" not in told.stderr
    assert picture.stat().st_size > 100_000
