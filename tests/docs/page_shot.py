"""The picture of the operator's page in README: a browser looks at a real run while the robot carries a part."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time

from tests.docs.page_moments import GL
from tests.processes import started

RUN = ("-m", "bracket_cell", "run", "--shift", "2", "--seed", "33", "--page", "0", "--log")
MOMENT = "Boolean(document.querySelector('#robot')?.textContent.includes('carrying'))"
LONGEST_S = 3600.0  # of wall time; a busy machine needs ten times as long as a quiet one


def shot() -> bytes:
    """PNG of the whole page at 1280 pixels.

    Raises:
        RuntimeError: the page was not served, or the moment never came.
    """
    from playwright.sync_api import sync_playwright

    with (
        tempfile.TemporaryDirectory() as folder,
        sync_playwright() as playwright,
        started([sys.executable, *RUN, f"{folder}/log.mcap"]) as run,
    ):
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=GL)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(_address(run))
        until_s = time.monotonic() + LONGEST_S
        while not page.evaluate(MOMENT):
            if time.monotonic() > until_s:
                raise RuntimeError(f"the robot carried nothing in {LONGEST_S:g} s")
            page.wait_for_timeout(50)
        return bytes(page.screenshot(full_page=True))


def _address(run: subprocess.Popen[str]) -> str:
    assert run.stderr is not None
    for line in run.stderr:
        if found := re.search(r"http://127\S+", line):
            return found.group()
    raise RuntimeError("no page was served")
