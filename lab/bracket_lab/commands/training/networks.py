"""How the networks of the detectors are trained: each on simulated recordings, unless others are given."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.commands.terminal import console
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.actions.settings import WHOLE_FRAMES, ActionTraining, Classes
from bracket_cell.learned.hands.mediapipe.hands import FETCH, ON_THE_BENCH, model_folder, network_file
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.parts.stacked import stacked_file
from bracket_cell.learned.semantic.confusions import Confusions, Reported
from bracket_cell.learned.semantic.graph import Layout
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.training.shares import ACTIONS, HANDS, STILLS, Share, made
from bracket_lab.commands.training.weights import Training, seconds
from bracket_lab.learned.actions.data import Segments
from bracket_lab.learned.hands.data import LabelledFrame
from bracket_lab.learned.parts.data import Scene
from bracket_lab.learned.training.schedule import MOST_EPOCHS
from bracket_lab.pictures.origins import WITHOUT_HANDS
from bracket_lab.pictures.scoring import CLASSICAL, MEASURES, TRIVIAL, Scorer, apart
from bracket_lab.wiring.latency import note_scores

Scores = Mapping[str, float]
HAND_DATA_S, HAND_EPOCH_S, HAND_VALIDATION = 1.02, 0.556, 0.04  # processor time of a recording, once; and a share
ACTION_S, ACTION_PHYSICS_S, ACTION_TRACKED_S = 3.0, 3.5, 30.0  # a recording; each frame drawn for a tracker
ACTION_DATA, VGG16_DATA, ACTION_VALIDATION = 0.75, 0.3, 0.1  # of the budget; where VGG16 is trained; a share
PIECE = 50  # recordings that are made at once: an interrupted training goes on with the next piece
PLATE_STILLS, LOOK_S, HOLES_DATA, STILL_S = 14, 1.4, 0.42, 0.005  # images of a look, to make it; share; to learn once
TRAY_VIEWS, TRAY_S, PARTS_DATA, IMAGE_S, THING_S = 3, 0.75, 0.3, 0.018, 0.0021
STACKED_SHARE, STACK_IMAGE_S = 0.4, 0.02  # of parts in the tray; to learn what lies on what in an image, in an epoch
PART_EPOCHS, STACK_EPOCHS, STACK_TIME = 20, 30, 0.35  # at most; of the time to learn, the share for stacks
STEEL_SHARE = 0.25  # of recordings to learn from; those for the scores show the product as it is
OWN_SHARE, OWN_FOLDS = 0.2, 5  # of a user's own recordings, kept for the scores
MOST_COMPARED = 60  # pictures on which new weights stand beside the classical detector
BOX_STEPS, BOX_BATCH = 500, 8  # of a network that knows pictures, on own boxes: 12 minutes of one core
CURVE = (0.25, 0.5)  # of the pictures, for a curve of the figure over their number
NO_POSES = (
    "boxes teach no poses: parts are seen and named, and none is grasped; with --simulated, poses of the drawn parts "
    "are learned beside them"
)
ASTRAY_SHARE, LYING_SHARE = 0.4, 0.35  # of parts on the plate and in the tray, far more than are met with


def hands(asked: Training, weights: Path) -> Scores:
    """Train finder, reader and refiner, and score them on frames that they never saw."""
    from bracket_cell.learned.hands.model import SlimReader
    from bracket_lab.learned.hands.data import frames_of
    from bracket_lab.learned.hands.evaluate import score_readings
    from bracket_lab.learned.hands.train import train_hands

    begin = None if asked.begin is None else WEIGHTS / weights.name if asked.begin == "shipped" else Path(asked.begin)
    epochs = asked.epochs or (9 if begin is None else 4)
    count = max(4, int(seconds(asked.budget) / (HAND_DATA_S + HAND_EPOCH_S * epochs)))
    configuration, product = asked.cell()
    setup, types = configuration.bench.overhead, tuple(product.parts)
    own = [frame for folder in asked.data or () for frame in frames_of(folder, types)]
    validation = 0 if own and not asked.simulated else max(2, int(HAND_VALIDATION * count))
    apart_from = _kept(own, asked) if own else set()
    folders, unseen = made(asked, weights, "hands", HANDS, count, validation=validation)
    kept = [frame for frame in own if frame.row.origin in apart_from]

    def score() -> dict[str, float]:
        scorer = Scorer(configuration, product, "hands", "slim", weights)
        drawn = frames_of(unseen) if validation else []
        measured = [frame for frame in (*kept, *drawn) if all(hand.points_m for hand in frame.row.hands)]
        scores = score_readings(SlimReader(setup, types, weights), configuration.bench, measured) if measured else {}
        return scores | scorer.scores((kept or drawn)[:MOST_COMPARED])

    return train_hands(
        folders,
        setup,
        product,
        weights,
        asked.seed,
        score=score,
        epochs=epochs,
        begin=begin,
        apart=apart_from,
        command=asked.command("hands", epochs=epochs),
    )


def _kept(frames: Sequence[LabelledFrame], asked: Training) -> set[str]:
    """Origins that are kept for the scores: whole recordings, and whole sources of photographs, each of either kind.

    Raises:
        InputError: there is one alone, and no simulated hands beside it.
    """
    kept = set[str]()
    for kind in (False, True):
        names = {frame.row.origin for frame in frames if frame.row.origin.endswith(WITHOUT_HANDS) is kind}
        kept |= apart(names, OWN_SHARE, asked.seed) if len(names) > 1 else set()
    if not kept and not asked.simulated:
        raise InputError("1 recording or source alone; 2 are needed, as one is kept for the scores, or --simulated")
    return kept


def holes(asked: Training, weights: Path) -> Scores:
    """Train the hole reader, and calibrate its probabilities."""
    from bracket_lab.learned.holes.evaluate import load_plates
    from bracket_lab.learned.holes.train import HoleTraining, train_holes
    from bracket_lab.learned.training.still_dataset import split

    budget_s = seconds(asked.budget)
    options = {"--stills": PLATE_STILLS, "--person": "varied", "--astray-share": ASTRAY_SHARE}
    looks = max(4, int(HOLES_DATA * budget_s / LOOK_S))
    folders, _ = made(asked, weights, "plates", STILLS, looks, options | {"--steel-share": STEEL_SHARE})
    configuration, product = asked.cell()
    read = load_plates(folders, product)
    affordable = int((1 - HOLES_DATA) * budget_s / (STILL_S * max(1, len(read))))
    settings = HoleTraining(epochs=asked.epochs or min(30, max(2, affordable)))
    command = asked.command("holes", epochs=settings.epochs)
    scores = train_holes(
        read, configuration.bench, product, weights, asked.seed, settings, command=command, quiet=False
    )
    _, kept = split(read, settings.validation_share, asked.seed)
    return scores | beside(asked, "holes", weights, kept)


def parts(asked: Training, weights: Path) -> Scores:
    """Train the networks of the part detector, that of stacks alone (kind stacked), or Faster R-CNN."""
    from bracket_lab.learned.parts.data import load_scenes
    from bracket_lab.learned.parts.train import posed_things, train_parts
    from bracket_lab.learned.training.still_dataset import split

    budget_s = seconds(asked.budget)
    options = {"--views": TRAY_VIEWS, "--lying-share": LYING_SHARE, "--steel-share": STEEL_SHARE}
    options |= {"--stacked-share": STACKED_SHARE}
    trays = max(4, int(PARTS_DATA * budget_s / TRAY_S))
    shares = STILLS if asked.look is None else (Share(asked.look, 1.0, 0),)
    folders, _ = made(asked, weights, "objects", shares, trays, options, ("--mixed",))
    configuration, product = asked.cell()
    scenes, kept = load_scenes(folders, product), list[Scene]()
    if asked.data:
        scenes, kept = split(scenes, OWN_SHARE, asked.seed)
    if asked.data and asked.kind != "stacked":
        _boxes(scenes, product)
    if asked.kind == "rcnn":
        return faster_rcnn(asked, scenes, product, weights)
    floor_m = configuration.bench.tray.centre_m[2]
    if asked.kind == "centre" and not posed_things(scenes):
        return boxed_parts(asked, scenes, product, floor_m, weights, kept)
    epochs, of_stacks = part_epochs(budget_s, len(scenes), sum(len(scene.labels) for scene in scenes))
    epochs, of_stacks = asked.epochs or epochs, asked.epochs or of_stacks
    if asked.kind == "stacked":
        return stacks(
            asked, scenes, product, floor_m, centre_net(weights), weights, epochs=asked.epochs or STACK_EPOCHS
        )
    command = asked.command("parts", epochs=epochs)
    facts = train_parts(scenes, product, floor_m, weights, asked.seed, epochs=epochs, command=command, quiet=False)
    scores = stacks(asked, scenes, product, floor_m, weights, stacked_file(weights), command, epochs=of_stacks)
    return {**facts, **scores, **beside(asked, "parts", weights, kept, scenes)}


def _boxes(scenes: Sequence[Scene], product: Product) -> Counter[str]:
    """How many there are of each type.

    Raises:
        InputError: no picture shows one of the product's types.
    """
    seen = Counter(label.part for scene in scenes for label in scene.labels)
    if unseen := [part for part in product.parts if not seen[part]]:
        named = f"only {', '.join(sorted(seen))}" if seen else "no part"
        raise InputError(f"--data: {named} labelled in {len(scenes)} pictures; none shows {', '.join(unseen)}")
    return seen


def boxed_parts(
    asked: Training, scenes: Sequence[Scene], product: Product, floor_m: float, weights: Path, kept: Sequence[Scene]
) -> Scores:
    """Train the part detector on boxes alone, as people give them."""
    from bracket_lab.learned.parts.train import train_parts

    seen, figures = _boxes(scenes, product), dict[str, float]()
    for share in (*CURVE, 1) if asked.curve else (1,):
        some, out = scenes[:: round(1 / share)], weights if share == 1 else weights.with_suffix(f".{share:g}.onnx")
        epochs = asked.epochs or box_epochs(len(some))
        command = asked.command("parts", epochs=epochs)
        facts = train_parts(some, product, floor_m, out, asked.seed, epochs=epochs, command=command, quiet=False)
        scores = beside(asked, "parts", out, kept, some)
        figures[f"map_50 of {len(some)} pictures"] = scores["map_50"]
    console().print(NO_POSES, highlight=False)
    return {**facts, **{f"boxes of {part}": seen[part] for part in seen}, **(figures if asked.curve else {}), **scores}


def faster_rcnn(asked: Training, scenes: Sequence[Scene], product: Product, weights: Path) -> Scores:
    """Train the paper's part detector, or a smaller one of its kind."""
    from bracket_lab.learned.parts.rcnn import train_rcnn
    from bracket_lab.learned.parts.settings import RcnnTraining
    from bracket_lab.learned.training.recipe import Task

    settings = RcnnTraining(backbone=asked.backbone, share=asked.share, steps=asked.steps)
    task = Task(out=weights, seed=asked.seed, command=asked.command("parts"), quiet=False)
    return train_rcnn(scenes, product, weights, settings, task)


def box_epochs(images: int) -> int:
    """Epochs on own boxes: as many steps on few images, as far as they may be repeated."""
    return min(MOST_EPOCHS, max(PART_EPOCHS, -(-BOX_STEPS * BOX_BATCH // images)))


def part_epochs(budget_s: float, images: int, things: int) -> tuple[int, int]:
    """Epochs of the centre net with its pose net, and of what tells of stacks, for what the data leave of a budget."""
    left_s = (1 - PARTS_DATA) * budget_s
    parts_s, stacks_s = IMAGE_S * images + THING_S * things, STACK_IMAGE_S * images
    most = ((PART_EPOCHS, (1 - STACK_TIME) * left_s / parts_s), (STACK_EPOCHS, STACK_TIME * left_s / stacks_s))
    centre, stacked = (min(limit, max(1, int(fit))) for limit, fit in most)
    return centre, stacked


def beside(
    asked: Training, task: str, weights: Path, kept: Sequence[Any], learned: Sequence[Any] = ()
) -> dict[str, float]:
    """The measure of a task, by the new weights and by the classical detector, on pictures that were kept apart.

    Args:
        learned: where none were kept, these tell whether the weights are worth anything, and no figure stands on the
            card.
    """
    configuration, product = asked.cell()
    some = kept or learned[:: max(1, len(learned) // MOST_COMPARED)]
    found = Scorer(configuration, product, task, asked.kind, weights).scores(some[:MOST_COMPARED])
    fields = {name: found[name] for name in (MEASURES[task], f"{MEASURES[task]}{CLASSICAL}")}
    if kept:
        note_scores(weights, fields)
    return fields


def stacks(
    asked: Training,
    scenes: Sequence[Scene],
    product: Product,
    floor_m: float,
    centre: Path,
    out: Path,
    command: str = "",
    *,
    epochs: int,
) -> Scores:
    """Train what tells who lies on whom, and how, by what a centre net sees; without any stack in the data, nothing."""
    from bracket_cell.learned.parts.model import CENTRE_KIND
    from bracket_lab.learned.parts.settings import StackTraining
    from bracket_lab.learned.parts.train_stacked import train_stacked

    if not any(label.on for scene in scenes for label in scene.labels):
        console().print("nothing lies on anything in these data: what tells of stacks is not trained", highlight=False)
        return {}
    model = OnnxModel.load(centre, CENTRE_KIND)
    command_line = command or model.card.command
    settings = StackTraining(epochs=epochs)
    return train_stacked(scenes, product, floor_m, model, out, asked.seed, settings, command=command_line, quiet=False)


def centre_net(stacked: Path) -> Path:
    """The centre net that the network of stacks belongs to: the one beside them, or else the shipped one."""
    beside = stacked.with_name(weights_file("parts", "centre"))
    return beside if beside.is_file() else WEIGHTS / beside.name


def actions(asked: Training, weights: Path) -> Scores:
    """Train a detector of actions, and write its confusion matrix."""
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task, train_actions

    configuration, product = asked.cell()
    task, budget_s = Task(configuration.bench, product), seconds(asked.budget)
    rate_hz = configuration.bench.overhead.rate_hz
    if asked.data and asked.validation is None:
        learned, kept = own_segments(load_segments(asked.data, task.classes, rate_hz))
    else:
        folders, unseen = asked.data, asked.validation
        if not folders or unseen is None:
            folders, unseen = recordings(asked, weights, budget_s)
            budget_s *= 1 - _data_share(asked)
        learned, kept = (load_segments(some, task.classes, rate_hz) for some in (folders, [unseen]))
    console().print(f"{len(learned)} segments to learn from, {len(kept)} for the scores")
    epochs = asked.epochs or 14
    settings, command = ActionTraining(epochs=epochs, share=asked.share), asked.command("actions", epochs=epochs)
    scores = train_actions(
        task,
        learned,
        kept,
        weights,
        asked.kind,
        seed=asked.seed,
        settings=settings,
        budget_s=budget_s,
        command=command,
        quiet=False,
    )
    confusion = OnnxModel.load(weights, f"actions.{asked.kind}").card.config["confusion"]
    counts = np.array(confusion["counts"])  # type: ignore[call-overload, index]
    save_confusions(confusions_of(weights), product, Classes.of(product).reports(counts), command)
    commonest = float(np.bincount(kept.classes).max()) / len(kept)
    return {**scores, f"accuracy{TRIVIAL}": round(commonest, 4)}


def own_segments(segments: Segments) -> tuple[Segments, Segments]:
    """Those to learn from, and those of one recording in five, for the scores.

    Raises:
        InputError: all are of one recording.
    """
    if len(set(segments.logs)) < 2:
        raise InputError("--data: segments of one recording alone; 2 are needed, or --validation: scores need one")
    return segments.without(0, min(OWN_FOLDS, len(set(segments.logs))))


def _data_share(asked: Training) -> float:
    return ACTION_DATA if asked.kind in ("slim", "track") or asked.tracker else VGG16_DATA


def recordings(asked: Training, weights: Path, budget_s: float) -> tuple[list[Path], Path]:
    """Folders of assemblies by the simulated person, to learn from and for the scores."""
    if asked.tracker and asked.look is None:
        raise InputError("--tracker goes with --look: the looks that are made by default have trackers of their own")
    shares: Sequence[Share] = ACTIONS
    if asked.look is not None:
        shares = [Share(asked.look, 1.0, 0, tracker=asked.tracker)]
    if not network_file(model_folder(), "landmark", ON_THE_BENCH).is_file():
        missing = [share for share in shares if share.tracker == "mediapipe"]
        if len(missing) == len(shares):
            raise InputError(f"--tracker mediapipe: its networks are not there; fetch them once with: {FETCH}")
        console().print(f"no recordings with MediaPipe's hands: its networks come with: {FETCH}", highlight=False)
        shares = [share for share in shares if share not in missing]
    each_s = sum(
        share.share * (ACTION_TRACKED_S if share.tracker else ACTION_PHYSICS_S if share.physics else ACTION_S)
        for share in shares
    )
    count = max(4, int(_data_share(asked) * budget_s / each_s))
    flags = ("--thin", "--gaps", *(["--frames"] if asked.kind in WHOLE_FRAMES else []))
    return made(
        asked,
        weights,
        "actions",
        shares,
        count,
        {"--steel-share": STEEL_SHARE},
        flags,
        validation=max(2, int(ACTION_VALIDATION * count)),
        piece=PIECE,
    )


def confusions_of(weights: Path) -> Path:
    """Where what a detector of actions takes for what stands: beside its weights."""
    return weights.with_name(f"{weights.stem}_confusions.json")


def save_confusions(path: Path, product: Product, reports: Sequence[Reported], source: str) -> None:
    """Write what reports say is taken for what, as `planners.semantic.confusions` reads it."""
    layout = Layout.of(product)
    Confusions.learned(layout, reports).save(path, layout, len(reports), source)
