"""Pictures of the operator's page in eight moments of a shift, at three sizes, light and dark.

    python -m tests.docs.page_moments FOLDER [--log LOG] [--language de]

With a log that holds images, its first bench image stands for the camera's.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import make_reader

from bracket_cell.settings import PageSettings
from bracket_ground.interfaces.observation import Image
from tests.cell.viewing.page.moments import MOMENTS, brought_to
from tests.cell.viewing.page.rig import PageRig

SIZES = {"laptop": (1280, 800), "wall": (1920, 1080), "tablet": (1024, 768)}
GL = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SCHEMES = ("light", "dark")
JPEG = b"\xff\xd8"  # how one begins


def photograph(folder: Path, image: Image | None = None, language: str = "en") -> list[Path]:
    """All pictures; FOLDER/MOMENT-SIZE-SCHEME.png."""
    from playwright.sync_api import sync_playwright

    folder.mkdir(parents=True, exist_ok=True)
    made = []
    with sync_playwright() as playwright:
        browser: Any = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=GL)
        for moment in MOMENTS:
            rig = PageRig(PageSettings(language=language))
            rig.image = image
            try:
                brought_to(rig, moment)
                for size, (width, height) in SIZES.items():
                    for scheme in SCHEMES:
                        viewport = {"width": width, "height": height}
                        context = browser.new_context(viewport=viewport, color_scheme=scheme)
                        page = context.new_page()
                        page.goto(rig.page.address)
                        for _ in range(20):
                            rig.tick()
                            time.sleep(0.1)
                        page.wait_for_timeout(400)
                        made.append(folder / f"{moment}-{size}-{scheme}.png")
                        page.screenshot(path=made[-1])
                        context.close()
            finally:
                rig.page.abandon()
        browser.close()
    return made


def image_of(log: Path) -> Image:
    """The first image of the bench in a log (height, width, RGB).

    Raises:
        ValueError: it has none.
    """
    with log.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages("/camera/overhead"):
            jpeg = message.data[message.data.find(JPEG) :]
            image: Any = cv2.imdecode(np.frombuffer(jpeg, np.uint8), 1)
            return np.ascontiguousarray(image[..., ::-1])
    raise ValueError(f"{log} holds no images")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--language", default="en")
    asked = parser.parse_args()
    for path in photograph(asked.folder, asked.log and image_of(asked.log), asked.language):
        sys.stdout.write(f"{path}\n")
