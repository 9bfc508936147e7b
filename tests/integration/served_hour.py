"""`cell serve` in a real browser for an hour, with trouble; each sentence of the page is compared with the log.

    python -m tests.integration.served_hour FOLDER --minutes 60

The network is lost four times, the server killed twice, a run killed once; an order is given and changed, and the page
speaks German from the middle on. Samples are in FOLDER/samples.jsonl, pictures at four sizes beside them.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from playwright.sync_api import Error, sync_playwright

from bracket_cell.log.read.reader import files_of, read_log
from bracket_ground.errors import CellError
from tests.cell.conftest import BROWSERS
from tests.cell.viewing.page.test_browser import Relay

SIZES = ((1280, 800), (800, 1280), (390, 844), (1920, 1080))
CUT_S, NOTICED_S, BACK_S = 15.0, 4.0, 12.0  # how long a network is lost; within which the page says so, and is back
HELD = {"hold", "stop", "HOLD", "STOP"}
STALE_TICKS = 30  # so many ticks a sentence may stand after it became false: 0.6 s, and a tick's way to the page
SAMPLE = """() => ({tick: Number(document.body.dataset.tick ?? -1), words: document.getElementById('words').textContent,
  robot: document.getElementById('robot').firstChild?.textContent ?? '', lang: document.documentElement.lang,
  moment: document.getElementById('do').dataset.moment, silent: document.body.classList.contains('silent'),
  between: document.body.classList.contains('between'), begin: !!document.querySelector('[data-begin]:not(:disabled)'),
  again: !!document.querySelector('[data-begin=again]:not(:disabled)')})"""


class Hour:
    """A server, a browser behind a relay, and what happens to them."""

    def __init__(self, folder: Path, minutes: float) -> None:
        self.folder, self.length_s = folder, 60 * minutes
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        folder.mkdir(parents=True)
        self.samples, self.done = (folder / "samples.jsonl").open("w"), Counter[str]()
        self.serve()

    def serve(self) -> None:
        """Start the server; its output is appended."""
        out = (self.folder / "serve.out").open("a")
        words = ["serve", "--page", str(self.port), "--shift", "2", "--seed", "7", "--look", "none"]
        command = [sys.executable, "-m", "bracket_cell", *words]
        self.server = subprocess.Popen(command, stdout=out, stderr=out, cwd=self.folder)

    def code(self) -> str:
        """The code that pairs a browser, once the server has printed one."""
        while not (found := re.findall(r"code to operate: ([\d ]+),", (self.folder / "serve.out").read_text())):
            time.sleep(0.2)
        return str(found[-1])

    def kill_server(self) -> None:
        self.server.kill()
        self.server.wait()
        self.serve()

    def kill_run(self) -> None:
        """The newest run that this folder's server began."""
        for entry in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words, where = entry.read_bytes().split(b"\0"), entry.with_name("cwd").readlink()
            except OSError:
                continue
            if where == self.folder and b"run" in words and any(word.endswith(b"run.sock") for word in words):
                os.kill(int(entry.parent.name), signal.SIGKILL)

    def watch(self, page: Any, relay: Relay) -> None:
        """Sample twice a second, press what a person would press, and let trouble come at its time."""
        trouble = {
            "cut": [0.08, 0.28, 0.48, 0.68],
            "kill_server": [0.18, 0.58],
            "kill_run": [0.8],
            "order": [0.02],
            "change": [0.38],
            "german": [0.5],
        }
        begun_s, cut_s, shot = time.monotonic(), -CUT_S, 0
        while (now_s := time.monotonic() - begun_s) < self.length_s:
            if relay.silent.is_set() and now_s - cut_s > CUT_S:
                relay.silent.clear()
            told = page.evaluate(SAMPLE)
            log = max((self.folder / "runs").glob("*.mcap"), default=None)
            name = "" if log is None else log.name.partition(".")[0]
            cut = now_s - cut_s if relay.silent.is_set() else -1.0
            self.samples.write(json.dumps({"s": round(now_s, 2), "cut": round(cut, 2), "log": name, **told}) + "\n")
            for what, times in trouble.items():
                if times and now_s > times[0] * self.length_s and (what != "kill_run" or not told["between"]):
                    times.pop(0)
                    self.done[what] += 1
                    if what == "cut":
                        cut_s = now_s
                        relay.silent.set()
                    else:
                        with suppress(Error):  # nothing can be pressed while there are no news
                            self.act(page, what)
            if told["begin"] and not told["silent"]:
                self.begin(page, "again" if told["again"] and told["moment"] == "alarm" else "new")
            if not told["between"] and not told["silent"] and now_s > (shot + 0.5) * self.length_s / 4:
                shot += 1
                self.pictures(page, f"{shot}-{told['moment']}")
            page.wait_for_timeout(500)

    def act(self, page: Any, what: str) -> None:
        if what in ("kill_server", "kill_run"):
            getattr(self, what)()
        elif what == "german":
            page.select_option("#language", "de")
        elif what == "order":
            page.evaluate("document.getElementById('form').open = true")
            page.fill("#orderId", "A17")
            page.fill("#amount", "4")
            page.click("#start")
        else:
            page.click("[data-change=A17]", timeout=3000)
            page.fill("#amount", "9")
            page.click("#start")

    def begin(self, page: Any, which: str) -> None:
        self.done["begin"] += 1
        for _ in range(2):  # after trouble it asks once more
            try:
                page.click(f"[data-begin={which}]", timeout=3000)
            except Error:
                return
            page.wait_for_timeout(1500)

    def pictures(self, page: Any, name: str) -> None:
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(200)
            page.screenshot(path=self.folder / f"{name}-{width}x{height}.png")
        page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})


def record(folder: Path, minutes: float) -> Counter[str]:
    """An hour, or as many minutes; returns how often each thing happened."""
    hour = Hour(folder, minutes)
    path = next(found for name in BROWSERS if (found := shutil.which(name)))
    with sync_playwright() as playwright, Relay(hour.port) as relay:
        rules = f"--host-resolver-rules=MAP localhost:{hour.port} 127.0.0.1:{relay.port}"
        browser = playwright.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--disable-3d-apis", f"{rules}"]
        )
        page = browser.new_page(viewport={"width": SIZES[0][0], "height": SIZES[0][1]})
        code = hour.code()
        page.goto(f"http://localhost:{hour.port}/")
        page.fill("#code", code)
        page.fill("#who", "Ada")
        page.click("#pair button")
        page.wait_for_timeout(2000)
        hour.watch(page, relay)
        browser.close()
    hour.kill_run()
    hour.server.kill()
    return hour.done


def false_moments(folder: Path) -> Iterator[tuple[dict[str, Any], str]]:
    """Samples that the log contradicts, or that take old news for new, with the reason."""
    samples = [json.loads(line) for line in (folder / "samples.jsonl").read_text().splitlines()]
    logs = {name: Facts(folder / "runs", name) for name in {row["log"] for row in samples} - {""}}
    since, last_tick, back = 0.0, (-1, ""), -BACK_S
    for row in samples:
        if (row["tick"], row["log"]) != last_tick or row["between"]:
            since, last_tick = row["s"], (row["tick"], row["log"])
        back = row["s"] if row["cut"] >= 0 else back
        if not row["words"]:
            yield row, "it says nothing"
        if row["cut"] > NOTICED_S and not row["silent"]:
            yield row, "the network is lost, and the page does not say so"
        if row["cut"] < 0 and row["silent"] and row["s"] - back > BACK_S and row["s"] - since < 1.0:
            yield row, "news come, and the page says that none do"
        if not row["silent"] and not row["between"] and row["s"] - since > NOTICED_S:
            yield row, f"the same tick for {row['s'] - since:.1f} s"
        if not row["silent"] and not row["between"] and row["lang"] == "en" and row["log"] in logs:
            for problem in logs[row["log"]].contradicts(row):
                yield row, problem


class Facts:
    """What a log says of each tick."""

    def __init__(self, folder: Path, name: str) -> None:
        self.filled: list[frozenset[str]] = []
        self.asked: list[bool] = []
        self.action: list[str] = []
        filled: set[str] = set()
        asked = False
        first = min(folder.glob(f"{name}*.mcap"))
        try:
            ticks = read_log(files_of(first)).ticks
        except CellError:
            ticks = ()  # the run was killed while it wrote its head
        for tick in ticks:
            for topic, fields in tick.notes:
                if topic == "bracket" and fields["edge"] == "begin" and not fields.get("resumed"):
                    filled.clear()
                if topic == "belief" and fields.get("edge"):
                    part, at = fields["edge"]
                    (filled.add if part is not None else filled.discard)(str(at))
            asked = bool(tick.display["questions"]) if tick.display is not None else asked
            self.filled.append(frozenset(filled))
            self.asked.append(asked)
            self.action.append(str((tick.judgement or {}).get("action", "")))

    def contradicts(self, row: dict[str, Any]) -> Iterator[str]:
        """What of a sample is false; a sentence may stand for a moment longer than it is true."""
        now = row["tick"]
        lately = range(max(0, now - STALE_TICKS), min(now + 1, len(self.filled)))
        if not lately:
            return
        words = row["words"]
        places = re.findall(r"(?:Place the [\w ]+ at|I bring the [\w ]+ to|I put the [\w ]+ into) (\w+)", words)
        for hole in places:
            if all(hole in self.filled[at] for at in lately):
                yield f"{hole} is filled already"
        if row["moment"] == "question" and not any(self.asked[at] for at in lately):
            yield "nothing is asked"
        held = {self.action[at] for at in lately}
        if row["moment"] == "alarm" and not held & HELD:
            yield f"an alarm, and the arm was allowed to {held}"
        if words.startswith("Take the bracket out: it is finished") and all(self.filled[at] == set() for at in lately):
            yield "nothing is in the bracket"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    given = parser.parse_args()
    done = record(given.folder.absolute(), given.minutes)
    rows = (given.folder / "samples.jsonl").read_text().splitlines()
    wrong = list(false_moments(given.folder))
    for row, problem in wrong:
        print(f"{row['s']} s, tick {row['tick']}: {problem}: {row['words']}")
    print(f"{dict(done)}; {len(wrong)} of {len(rows)} samples are false")


if __name__ == "__main__":
    main()
