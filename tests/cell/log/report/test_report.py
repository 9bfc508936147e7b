"""The report: whole, self-contained, and shown by a browser without an error."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove import messages

from bracket_cell.log.read.mcap_file import Message
from bracket_cell.log.read.reader import Log
from bracket_cell.log.report.report import report_html, write_report
from bracket_cell.log.report.summary import beliefs, node_rows, placements, verdicts
from bracket_ground.errors import InputError, LogError
from tests.cell.log.report.outline import Outline, outline_of
from tests.processes import finished

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PROBE = """
addEventListener("error", (event) => event.target === window || console.error("does not load", event.target), true);
addEventListener("load", () => {
  for (const found of performance.getEntriesByType("resource"))
    if (!found.name.startsWith("data:")) console.error("loads", found.name);
  for (const shown of document.querySelectorAll("image, img")) {
    const picture = new Image();
    picture.onerror = () => console.error("a picture does not show");
    picture.src = shown.src || shown.href.baseVal;
  }
});
"""


@pytest.fixture(scope="module")
def page(assembly_log: Log) -> str:
    return report_html(assembly_log)


@pytest.fixture(scope="module")
def outline(page: str) -> Outline:
    return outline_of(page)


def test_page_is_well_formed_and_has_all_sections(outline: Outline) -> None:
    assert outline.open == []
    sections = {"timeline", "belief", "placements", "verdicts", "waits", "timing", "lines", "frames"}
    assert sections <= set(outline.ids)


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


def test_where_the_time_went_is_told_of_logs_that_know_it(assembly_log: Log) -> None:
    split = {"robot_idle": "0.5", "human_idle": "0.4", "concurrent": "0.2", "held_s": "3.9"}
    assert "nobody acts" not in report_html(replace(assembly_log, result=split))
    told = {**split, "slowed_s": "8.7", "lost_alone_s": "6.3"}
    shown = report_html(replace(assembly_log, result=told))
    assert "30% / 20% / 40% / 10%" in shown
    assert "3.9 / 8.7 s, 6.3 s of it while the person rests" in shown


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


def browsed(page: Path, *options: str) -> list[str]:
    """What a browser's console says of a page; where none is installed, skips, or fails if one is required."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        missing = f"no browser is installed, so nobody has looked at the page: {', '.join(BROWSERS)}"
        if os.environ.get("REQUIRE_BROWSER"):
            pytest.fail(missing)
        pytest.skip(missing)
    common = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--hide-scrollbars"]
    common += ["--virtual-time-budget=5000"]
    common += [f"--user-data-dir={page.parent / 'browser'}", "--enable-logging=stderr", *options]
    told = finished([browser, *common, page.as_uri()])
    return [line for line in told.stderr.splitlines() if "CONSOLE" in line]


def watched(page: str, folder: Path) -> Path:
    """The page in a file, with a script that complains of pictures that do not show and of anything loaded."""
    file = folder / "report.html"
    file.write_text(page.replace("<head>", f"<head><script>{PROBE}</script>"))
    return file


def test_browser_shows_it_without_an_error(page: str, tmp_path: Path) -> None:
    picture = tmp_path / "report.png"
    assert browsed(watched(page, tmp_path), "--window-size=1280,3000", f"--screenshot={picture}") == []
    image = cv2.imread(str(picture))
    assert image is not None
    assert len(np.unique(image[::4, ::4].reshape(-1, 3), axis=0)) > 500, "key frames and charts have many colours"


@pytest.mark.long
@pytest.mark.parametrize(
    ("whole", "broken"),
    [
        ("</main>", "<script>notDefined()</script></main>"),
        ("</main>", '<img src="missing.png"></main>'),
        ("</main>", '<link rel="stylesheet" href="file:///none.css"></main>'),
        ("data:image/jpeg;base64,/9j/", "data:image/jpeg;base64,AAAA"),
    ],
)
def test_a_broken_page_is_told_by_the_browser(page: str, whole: str, broken: str, tmp_path: Path) -> None:
    """So that the test above can fail."""
    assert whole in page
    file = watched(page.replace(whole, broken, 1), tmp_path)
    assert browsed(file, f"--screenshot={tmp_path / 'report.png'}")


@pytest.mark.parametrize("width_px", [360, 1280])
def test_it_fits_the_width_of_phones_and_laptops(page: str, width_px: int, tmp_path: Path) -> None:
    """Charts scroll by themselves; the page does not. A window is never as narrow as a phone, a frame may be."""
    measure = "<script>console.log('wide', document.documentElement.scrollWidth, innerWidth)</script>"
    (tmp_path / "report.html").write_text(page.replace("</body>", f"{measure}</body>"))
    frame = tmp_path / "frame.html"
    frame.write_text(f'<!DOCTYPE html><iframe src="report.html" width="{width_px}" height="800"></iframe>')
    [line] = browsed(frame, "--window-size=1400,900", f"--screenshot={tmp_path / 'report.png'}")
    scrolled, inner = (int(number) for number in re.findall(r"wide (\d+) (\d+)", line)[0])
    assert inner == width_px
    assert scrolled <= inner


def test_a_run_of_ten_minutes_is_a_page_under_5_mb(assembly_log: Log) -> None:
    length_s = assembly_log.ticks[-1].time_s + 0.04
    times = round(600 / length_s)
    ticks = [
        replace(tick, number=tick.number + turn * len(assembly_log.ticks), time_s=tick.time_s + turn * length_s)
        for turn in range(times)
        for tick in assembly_log.ticks
    ]
    page = report_html(replace(assembly_log, ticks=tuple(ticks)))
    assert len(page) < 5_000_000


def test_alarms_and_overruns_are_told(assembly_log: Log) -> None:
    said = messages.Log(level=messages.LogLevel.Error, message="the log cannot be written: no space", name="controller")
    line = Message("/log", "protobuf", 2_000_000_000, said.encode())
    late = replace(assembly_log.ticks[7], overrun=True, wall_s=0.0777)
    others = [replace(tick, overrun=False) for tick in assembly_log.ticks]  # on a busy machine some were later still
    ticks = (*others[:7], late, *others[8:])
    page = report_html(replace(assembly_log, ticks=ticks, messages=(*assembly_log.messages, line, line)))
    assert page.count("no space") == 1
    assert "(2 times)" in page
    assert "77.7 ms" in page
    assert '<span class="badge error">error</span>' in page


def test_a_later_part_is_told_from_its_own_beginning(assembly_log: Log) -> None:
    """Times and goals are those of the run, whatever tick the log begins with."""
    whole = report_html(assembly_log)
    begin = next(place for place, tick in enumerate(assembly_log.ticks) if tick.time_s >= 3.0)
    part = report_html(replace(assembly_log, ticks=assembly_log.ticks[begin:]))
    assert "3 s</text>" in part
    assert "1 s</text>" in whole
    assert "1 s</text>" not in part
    assert [placement.goal for placement in placements(assembly_log)] == [
        placement.goal for placement in placements(replace(assembly_log, ticks=assembly_log.ticks[begin:]))
    ]
