"""`cell lab data stacks` and `cell lab eval stacks`: objects that lie on each other, in VMRD's files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
from rich.progress import track
from typer import Option

from cell.commands.options import JsonOption, SchedulerOption, WorkersOption
from cell.commands.terminal import console, print_json, table
from cell.errors import InputError
from cell.files.files import MANIFEST, whole_folder, write_whole
from cell.fleet.engine import mapped
from cell.interfaces.stacks import VMRD_CLASSES, StackedScene
from learned.lab.stacks.vmrd import write_scene, write_splits
from sim.data.folder import JPEG_QUALITY
from sim.stacks.draw import draw_stack
from sim.stacks.settings import StackSettings

TESTED = 10  # every tenth picture is for tests, as in VMRD
BATCH = 8  # scenes that a worker is asked for at once
OutFolder = Annotated[Path, Option("--out", "-o", help="New folder.")]


def draw_stacks(
    out: OutFolder,
    scenes: Annotated[int, Option(min=TESTED, help="Pictures; every tenth is for tests.")] = 4683,
    first_seed: Annotated[int, Option("--first-seed", min=0, help="Of the first picture; each has its own.")] = 0,
    classes: Annotated[
        str, Option(help="Numbers of classes that pictures are drawn from in turn, in VMRD's order, as 5,10,20,31.")
    ] = str(len(VMRD_CLASSES)),
    deepest: Annotated[int, Option(min=1, max=4, help="Most objects below one another, the lowest aside.")] = 4,
    stacked_share: Annotated[float, Option(min=0, max=1, help="Share of objects that are put onto others.")] = 0.85,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Pictures of stacked everyday objects with who lies on whom, in VMRD's format."""
    counts = numbers_of_classes(classes)
    settings = [StackSettings(deepest=deepest, stacked_share=stacked_share, kinds=count) for count in counts]
    asked = [(seed, settings[seed % len(settings)]) for seed in range(first_seed, first_seed + scenes)]
    batches = [(asked[first : first + BATCH],) for first in range(0, scenes, BATCH)]
    names: list[str] = []
    objects = on_others = 0
    with whole_folder(out) as folder:
        answers = mapped(_drawn, batches, workers, scheduler)
        for batch in track(answers, "stacks", console=console(), total=len(batches)):
            for scene, jpeg in batch:
                write_scene(folder, scene, jpeg)
                names.append(scene.name)
                objects += len(scene.objects)
                on_others += sum(bool(one.fathers) for one in scene.objects)
        tested = [place // len(counts) % TESTED == TESTED - 1 for place in range(scenes)]  # of each number of classes
        test = [name for name, one in zip(names, tested, strict=True) if one]
        write_splits(folder, (name for name, one in zip(names, tested, strict=True) if not one), test)
        facts = {"scenes": scenes, "test": len(test), "objects": objects, "on_others": on_others}
        command = f"cell lab data stacks --scenes {scenes} --first-seed {first_seed} --classes {classes}"
        command += f" --deepest {deepest} --stacked-share {stacked_share:g}"
        told = {"format": "cell.stacks", "version": 1, "made_by": command, **facts}
        write_whole(folder / MANIFEST, _json(told))
    console().print(table(str(out), facts))
    if as_json:
        print_json(told)


def numbers_of_classes(text: str) -> list[int]:
    """Numbers of "5,10,20,31".

    Raises:
        InputError: it is written otherwise, or names more classes than there are.
    """
    words = text.split(",")
    if not all(word.strip().isdecimal() and 5 <= int(word) <= len(VMRD_CLASSES) for word in words):
        raise InputError(f"--classes {text}: must be numbers from 5 to {len(VMRD_CLASSES)}, as 5,10,20,31")
    return [int(word) for word in words]


def _json(values: dict[str, object]) -> bytes:
    import json

    return (json.dumps(values, indent=2) + "\n").encode()


def _drawn(asked: list[tuple[int, StackSettings]]) -> list[tuple[StackedScene, bytes]]:
    """Scenes with their pictures as JPEG."""
    found = []
    for seed, settings in asked:
        drawn = draw_stack(seed, settings)
        bgr, quality = cv2.cvtColor(drawn.image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        found.append((drawn.scene, cv2.imencode(".jpg", bgr, quality)[1].tobytes()))
    return found
