"""`cell lab data stacks` and `cell lab eval stacks`: objects that lie on each other, in VMRD's files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import cv2
from rich.progress import track
from typer import Option

from bracket_cell.commands.options import JsonOption, SchedulerOption, SeedOption, WorkersOption
from bracket_cell.commands.terminal import console, print_json, report_scores, table
from bracket_cell.fleet.engine import mapped
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import JPEG_QUALITY
from bracket_ground.files.files import MANIFEST, whole_folder, write_whole
from bracket_ground.interfaces.stacks import VMRD_CLASSES, StackedScene
from bracket_lab.experiments.stacks.checks import LEARNED, RULES, StackTraining
from bracket_lab.experiments.stacks.vmrd import read_vmrd, write_scene, write_splits
from bracket_lab.stacks.draw import draw_stack
from bracket_sim.stacks.settings import StackSettings

KEPT = Path("data")  # finished cells and features
TESTED = 10  # every tenth picture is for tests, as in VMRD
BATCH = 8  # scenes that a worker is asked for at once
OutFolder = Annotated[Path, Option("--out", "-o", help="New folder.")]


def draw_stacks(
    out: OutFolder,
    scenes: Annotated[int, Option(min=TESTED, help="Pictures; every tenth is for tests.")] = 4683,
    classes: Annotated[
        str, Option(help="Numbers of classes that pictures are drawn from in turn, in VMRD's order, as 5,10,20,31.")
    ] = str(len(VMRD_CLASSES)),
    deepest: Annotated[int, Option(min=1, max=4, help="Most objects below one another, the lowest aside.")] = 4,
    stacked_share: Annotated[float, Option(min=0, max=1, help="Share of objects that are put onto others.")] = 0.85,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Pictures of stacked everyday objects with who lies on whom, in VMRD's format."""
    counts = numbers_of_classes(classes)
    settings = [StackSettings(deepest=deepest, stacked_share=stacked_share, kinds=count) for count in counts]
    asked = [(number, settings[number % len(settings)]) for number in range(scenes)]
    batches = [(asked[first : first + BATCH],) for first in range(0, scenes, BATCH)]
    names: list[str] = []
    objects = on_others = 0
    with whole_folder(out) as folder:
        answers = mapped(partial(_drawn, seed), batches, workers, scheduler)
        for batch in track(answers, "stacks", console=console(), total=len(batches)):
            for scene, jpeg in batch:
                write_scene(folder, scene, jpeg)
                names.append(scene.name)
                objects += len(scene.objects)
                on_others += sum(bool(item.fathers) for item in scene.objects)
        tested = [place // len(counts) % TESTED == TESTED - 1 for place in range(scenes)]  # of each number of classes
        test = [name for name, is_test in zip(names, tested, strict=True) if is_test]
        write_splits(folder, (name for name, is_test in zip(names, tested, strict=True) if not is_test), test)
        facts = {"scenes": scenes, "test": len(test), "objects": objects, "on_others": on_others}
        command = f"cell lab data stacks --scenes {scenes} --seed {seed} --classes {classes}"
        command += f" --deepest {deepest} --stacked-share {stacked_share:g}"
        fields = {"format": "cell.stacks", "version": 1, "made_by": command, **facts}
        write_whole(folder / MANIFEST, _json(fields))
    console().print(table(str(out), facts))
    if as_json:
        print_json(fields)


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


def _drawn(seed: int, asked: list[tuple[int, StackSettings]]) -> list[tuple[StackedScene, bytes]]:
    """Scenes with their pictures as JPEG."""
    found = []
    for number, settings in asked:
        drawn = draw_stack(number, settings, seed)
        bgr, quality = cv2.cvtColor(drawn.image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        found.append((drawn.scene, cv2.imencode(".jpg", bgr, quality)[1].tobytes()))
    return found


def evaluate_stacks(
    data: Annotated[Path, Option("--data", help="Folder of VMRD.")],
    classes: Annotated[
        str | None, Option(help="Numbers of classes, in VMRD's order; several, as 5,10,20,31, for Fig. 18.")
    ] = None,
    share: Annotated[
        float, Option(min=0.05, max=1, help="Of the papers' networks: EfficientNet-Lite0 below 1, ResNet-101 at 1.")
    ] = StackTraining().share,
    kind: Annotated[list[str] | None, Option(help="Only this planner; may be repeated.")] = None,
    detector_of: Annotated[
        Path | None, Option("--detector-of", help="Folder that the detector learns from; --data by default.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Score planners of what lies on what, trained on the same folder: Table 4, or, for several counts, Fig. 18.

    OR, OP and IA as VMRN counts; answer is the paper's IA. Finished cells and features stay in data/.
    """
    kinds, read = _kinds(kind), read_vmrd(data)
    other = None if detector_of is None else read_vmrd(detector_of)
    if other is not None and other.classes != read.classes:
        raise InputError(f"--detector-of {detector_of}: its classes are not those of {data}")
    counts = [len(read.classes)] if classes is None else numbers_of_classes(classes)
    from bracket_lab.experiments.experiments import kept, measured
    from bracket_lab.experiments.stacks.experiment import TITLES, Study, printed_ia

    settings = StackTraining(classes=read.classes, share=share)
    study = Study(read, KEPT / "stacks", settings, seed, other)
    cells = measured("stacks", study.cells(counts, kinds), kept(KEPT / "stacks" / "experiments.jsonl"))
    for key, values in cells:
        report_scores(f"{TITLES[key['planner']]}, {key['boxes']} boxes, {key['classes']} classes", values, False)
    if as_json:
        rows = [{name: key[name] for name in ("planner", "boxes", "classes")} | values for key, values in cells]
        print_json({"data": str(data), "paper": printed_ia(), "rows": rows})


def _kinds(asked: list[str] | None) -> list[str]:
    legal = (*LEARNED, *RULES)
    if unknown := [name for name in asked or () if name not in legal]:
        raise InputError(f"--kind {unknown[0]}: unknown planner; legal: {', '.join(legal)}")
    return [name for name in legal if not asked or name in asked]
