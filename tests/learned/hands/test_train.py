"""The small tracker learns from a folder of frames, and what it learned can be loaded and asked."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from bracket_cell.configuration import load_configuration, load_product  # noqa: E402
from bracket_cell.kinds import WEIGHTS  # noqa: E402
from bracket_cell.learned.hands.model import (  # noqa: E402
    FINDER_KIND,
    READER_KIND,
    REFINER_KIND,
    SlimReader,
    finder_file,
    refiner_file,
)
from bracket_cell.learned.hands.refinement import CLOSE_PX  # noqa: E402
from bracket_cell.learned.hands.regions import AROUND_PX, CELL_PX, POINTS, Regions, centre_of  # noqa: E402
from bracket_cell.learned.inference.onnx_model import OnnxModel  # noqa: E402
from bracket_ground.errors import InputError, ModelError  # noqa: E402
from bracket_lab.learned.hands.augment import turned_images, varied  # noqa: E402
from bracket_lab.learned.hands.data import NO_HAND_WITHIN, NO_HANDS, HandData, frames_of, load_hands  # noqa: E402
from bracket_lab.learned.hands.evaluate import score_readings  # noqa: E402
from bracket_lab.learned.hands.examples import finder_targets, mirrored, reader_batch, refiner_batch  # noqa: E402
from bracket_lab.learned.hands.network import HEAT_PX, Finder, Reader, soft_argmax  # noqa: E402
from bracket_lab.learned.hands.refiner import Refiner  # noqa: E402
from bracket_lab.learned.hands.train import (  # noqa: E402
    heat_target,
    reader_loss,
    refiner_loss,
    train_hands,
)
from bracket_lab.learned.training.recipe import Recipe, Task  # noqa: E402
from bracket_lab.learned.training.torch_model import begin_with  # noqa: E402

pytestmark = pytest.mark.torch

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
SETUP, TYPES = BENCH.overhead, tuple(PRODUCT.parts)
SHAPE = {
    "palm": (0, 20),
    "pinch": (0, -20),
    "thumb": (-8, -18),
    "index": (8, -22),
    "wrist": (2, 40),
    "radial": (-9, 19),
    "ulnar": (9, 21),
}
SHAPE["held"] = (0, -30)


def hand(x: float, y: float, held: str | None = None, visible: float = 1.0) -> dict[str, Any]:
    points = {name: (x + dx, y + dy) for name, (dx, dy) in SHAPE.items() if held or name != "held"}
    return {
        "acting": True,
        "side": "right",
        "box_px": [x - 20, y - 35, x + 20, y + 45],
        "held_part": held,
        "visible": visible,
        "points_px": points,
        "points_m": dict.fromkeys(points, (0.7, 0.1, 0.12)) | {"wrist": (0.76, 0.1, 0.12)},
    }


def folder_of(path: Path, frames: int = 40) -> Path:
    """Frames with one bright thing each, which is called a hand; the last one has none."""
    rng = np.random.default_rng(2)
    path.mkdir()
    rows: list[dict[str, Any]] = [{"format": "cell.hands", "version": 1, "source": "test"}]
    for number in range(frames):
        image = rng.integers(60, 90, (SETUP.height_px, SETUP.width_px, 3)).astype(np.uint8)
        hands = []
        if number < frames - 1:
            x, y = rng.uniform((80, 80), (400, 280))
            cv2.ellipse(image, (round(x), round(y)), (14, 32), 0, 0, 360, (120, 160, 220), -1)
            hands.append(hand(float(x), float(y), TYPES[0] if number % 2 else None))
        cv2.imwrite(str(path / f"{number}.jpg"), image)
        rows.append({"file": f"{number}.jpg", "log": "one", "frame": number, "time_s": 0.0, "hands": hands})
    (path / "hands.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(tmp_path_factory.mktemp("hands") / "data")


@pytest.fixture(scope="module")
def data(folder: Path) -> HandData:
    return load_hands([folder], SETUP, TYPES, 0)


def test_regions_lie_about_their_hands(data: HandData) -> None:
    regions = Regions.of(SETUP)
    assert len(data.small) == 40
    assert len(data.centres) == 39
    hands = data.facts[:, 0] == 1
    assert hands.sum() == 39
    assert np.allclose(data.points[hands][:, :2].mean(axis=1), 0.5, atol=1e-6)  # the middle of palm and pinch
    assert np.isnan(data.points[~hands]).all()
    for patch in data.patches[hands]:
        middle = patch[len(patch) // 2 - 2 : len(patch) // 2 + 2, len(patch) // 2 - 2 : len(patch) // 2 + 2]
        assert middle.mean() > 140
    point = np.array([123.0, 77.0])
    centre = centre_of(point, point + 10)
    assert np.allclose(regions.outside(regions.inside(point, centre), centre), point)


def test_surroundings_show_more_about_the_same_place(data: HandData) -> None:
    regions, bright = Regions.of(SETUP), data.small.astype(int).sum(axis=3)
    for frame, x, y in data.centres[:10]:
        centre = np.array([x, y]) * regions.size_px - 0.5
        seen = regions.around(data.small[int(frame)], centre)
        assert seen.shape == (AROUND_PX, AROUND_PX, 3)
        middle = seen[AROUND_PX // 2 - 1 : AROUND_PX // 2 + 1, AROUND_PX // 2 - 1 : AROUND_PX // 2 + 1]
        assert middle.astype(int).sum(axis=2).mean() > 1.5 * np.median(bright[int(frame)])
        larger = regions.around(data.small[int(frame)], centre, 0.0, 2.0)
        assert (larger.astype(int).sum(axis=2) > 400).sum() > 2 * (seen.astype(int).sum(axis=2) > 400).sum()


def test_the_finder_is_to_find_each_hand_in_its_cell(data: HandData) -> None:
    every = np.arange(len(data.small))
    score, offset, weight = finder_targets(data, every, np.zeros(len(every)))
    assert (score == 1).sum() == len(data.centres)
    assert weight.min() == 1
    rows, columns = score.shape[2:]
    for frame, x, y in data.centres:
        row, column = int(y * rows), int(x * columns)
        assert score[int(frame), 0, row, column] == 1
        assert offset[int(frame), :, row, column] == pytest.approx([x * columns - column, y * rows - row], abs=1e-6)


@pytest.mark.parametrize("wider", [1, 2])
def test_hands_are_where_they_are_seen_in_turned_images(data: HandData, wider: int) -> None:
    """Also of a camera whose images are not as wide for their height as those that the finder sees."""
    data = replace(data, regions=replace(data.regions, width_px=wider * data.regions.width_px))
    rows, turns = np.arange(0, 36, 3), np.linspace(-1.5, 1.5, 12)
    score, offset, weight = finder_targets(data, rows, turns)
    images = turned_images(data.small[rows], turns)
    shown = (score == 1).any(axis=(1, 2, 3))
    assert shown.sum() >= 8  # the others are turned out of the image
    for image, one, where, known in zip(images[shown], score[shown], offset[shown], weight[shown], strict=True):
        row, column = np.argwhere(one[0] == 1)[0]
        x, y = (np.array([column, row]) + where[:, row, column]) * CELL_PX - 0.5
        bright = image.astype(int).sum(axis=2) > 400
        assert known[0, row, column] == 1
        assert np.allclose(np.argwhere(bright).mean(axis=0)[::-1], [x, y], atol=2)


def test_the_mean_of_a_sharp_heatmap_is_its_place() -> None:
    places = torch.tensor([[[0.3, 0.7], [0.55, 0.45]]])
    heat = (heat_target(places) + 1e-9).log().view(1, 2, HEAT_PX, HEAT_PX)
    assert torch.allclose(soft_argmax(heat), places, atol=0.002)
    assert torch.allclose(heat_target(places).sum(dim=2), torch.ones(1, 2))


def test_a_mirror_makes_a_left_hand_and_a_second_one_undoes_it(data: HandData) -> None:
    batch = reader_batch(data, np.arange(12), np.random.default_rng(0))
    before = {name: value.clone() for name, value in batch.items()}
    every = torch.ones(12, dtype=torch.bool)
    once = mirrored(dict(batch), every)
    present = before["facts"][:, 0] > 0
    assert torch.equal(once["facts"][present, 1], 1 - before["facts"][present, 1])
    assert torch.allclose(once["points"][present, 0, 0], 1 - before["points"][present, 0, 0])
    assert torch.allclose(once["points"][present, 0, 1], before["points"][present, 0, 1])
    twice = mirrored(once, every)
    for name, value in before.items():
        assert torch.allclose(torch.nan_to_num(twice[name].float()), torch.nan_to_num(value.float()), atol=1e-6), name


def test_varied_images_keep_their_shape_and_the_same_seed_gives_the_same() -> None:
    images = torch.rand(6, 3, 32, 40)
    one, two = (varied(images.clone(), np.random.default_rng(4))[0] for _ in range(2))
    assert one.shape == images.shape
    assert torch.equal(one, two)
    assert not torch.equal(one, images)


@pytest.mark.long
def test_the_reader_learns_a_batch(data: HandData) -> None:
    torch.manual_seed(0)
    network, rng = Reader(len(TYPES)), np.random.default_rng(1)
    batch = reader_batch(data, np.arange(8), rng)
    optimiser = torch.optim.AdamW(network.parameters(), lr=3e-3)
    losses = []
    for _ in range(25):
        loss = reader_loss(network, batch)
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.5 * losses[0]


def test_closeups_are_upright_and_their_truth_moves_with_them(data: HandData) -> None:
    rows = np.flatnonzero(data.facts[:, 0] == 1)[:16]
    batch = refiner_batch(data, rows, np.random.default_rng(3))
    palm, wrist = (batch["points"][:, POINTS.index(name)].numpy() for name in ("palm", "wrist"))
    along = (palm - wrist) * CLOSE_PX
    assert (along[:, 1] < 0).all()  # it points up
    assert np.median(np.abs(along[:, 0] / along[:, 1])) < 0.2
    seen = np.log(np.linalg.norm(along, axis=1)) - batch["ratio"].numpy()  # all hands of this folder are alike
    assert np.allclose(seen, seen.mean(), atol=1e-3)


@pytest.mark.slow
def test_the_refiner_learns_how_much_larger_a_hand_is_than_was_thought(data: HandData) -> None:
    torch.manual_seed(0)
    torch.set_num_threads(1)
    network, rng = Refiner(), np.random.default_rng(4)
    optimiser = torch.optim.AdamW(network.parameters(), 3e-3)
    rows = np.flatnonzero(data.facts[:, 0] == 1)[:16]
    losses = []
    for _ in range(30):
        loss = refiner_loss(network, refiner_batch(data, rows, rng))
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        losses.append(float(loss.detach()))
    assert np.mean(losses[-5:]) < np.mean(losses[:5]) - 0.5


@pytest.mark.long
def test_training_writes_three_files_that_find_hands(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "hands_slim.onnx"
    scores = train_hands(
        [folder],
        SETUP,
        PRODUCT,
        out,
        seed=0,
        score=lambda: score_readings(SlimReader(SETUP, TYPES, out), BENCH, frames_of(folder)),
        epochs=1,
        quiet=True,
    )
    assert out.exists()
    assert finder_file(out).exists()
    assert refiner_file(out).exists()
    assert 0 <= scores["found"] <= 1
    reader = SlimReader(SETUP, TYPES, out)
    image = np.full((SETUP.height_px, SETUP.width_px, 3), 80, np.uint8)
    for reading in reader.read(image, [np.array([240.0, 180.0])]):
        assert set(reading.points_px) >= set(POINTS[:5])
    other = SlimReader(SETUP, ("x", "y", "z"), out)
    assert all(reading.held_part is None for reading in other.read(image, [np.array([240.0, 180.0])]))


@pytest.mark.slow
def test_a_training_that_was_interrupted_goes_on_after_the_networks_that_are_made(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def train(again: Path) -> None:
        train_hands([folder], SETUP, PRODUCT, again, seed=0, score=dict, epochs=1, quiet=True)

    out = tmp_path / "hands_slim.onnx"
    fit, interrupted_at = Recipe.fit, [REFINER_KIND]

    def fitted(recipe: Recipe, task: Task) -> None:
        if recipe.kind in interrupted_at:
            raise InterruptedError
        fit(recipe, task)

    monkeypatch.setattr(Recipe, "fit", fitted)
    for kinds in ([REFINER_KIND], [READER_KIND]):  # before the first checkpoint of either
        interrupted_at[:] = kinds
        with pytest.raises(InterruptedError):
            train(out)
    interrupted_at[:] = [FINDER_KIND, REFINER_KIND]
    train(out)
    assert out.exists()
    with pytest.raises(InterruptedError):  # whole: it is trained anew
        train(out)


def test_what_looks_like_a_hand_is_shown_as_none_unless_one_is_there(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "data", frames=60)
    rows = [json.loads(line) for line in (folder / "hands.jsonl").read_text().splitlines()]
    side_px = Regions.of(SETUP).side_px
    apart: list[tuple[int, Any]] = []
    for frame, row in enumerate(rows[1:-1]):
        x, y = row["hands"][0]["points_px"]["palm"]
        row["tool_px"] = [x + (side_px if x < SETUP.width_px / 2 else -side_px), y]
        row["decoys_px"] = [[x, y + (side_px if y < SETUP.height_px / 2 else -side_px)], [x + 5, y]]
        apart += [(frame, place) for place in (row["tool_px"], row["decoys_px"][0])]
    (folder / "hands.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    data = load_hands([folder], SETUP, TYPES, 0)
    empty = data.facts[:, 0] == 0
    for frame, centre in zip(data.frames[empty], data.centres_px[empty], strict=True):
        for hand in rows[1 + frame]["hands"]:
            middle = centre_of(*(np.array(hand["points_px"][name]) for name in ("palm", "pinch")))
            assert np.abs(centre - middle).max() > NO_HAND_WITHIN * side_px
    shown = [
        any(f == frame and np.abs(centre - place).max() < 0.4 * side_px for f, centre in zip(*known, strict=True))
        for known in [(data.frames[empty], data.centres_px[empty])]
        for frame, place in apart
    ]
    assert np.mean(shown) > 0.4  # of four kinds of places two are shown
    with_hands = [frame for frame, row in enumerate(rows[1:]) if row["hands"]]
    assert np.isin(data.frames[empty], with_hands).sum() <= NO_HANDS * len(with_hands)


def test_what_nobody_knows_of_a_hand_is_not_learned(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "data", frames=6)
    rows = [json.loads(line) for line in (folder / "hands.jsonl").read_text().splitlines()]
    for row in rows[1:]:
        row["hands"] = [{"box_px": one["box_px"], "known": False} for one in row["hands"]]
    (folder / "hands.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    data = load_hands([folder], SETUP, TYPES, 0)
    shown = np.flatnonzero(data.facts[:, 0] == 1)
    assert np.isnan(data.heights_m[shown]).all()
    assert np.isnan(data.points[shown]).all()
    loss = reader_loss(Reader(len(TYPES)), reader_batch(data, np.arange(len(data.facts)), np.random.default_rng(0)))
    assert torch.isfinite(loss)


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cell lab data hands"):
        load_hands([tmp_path], SETUP, TYPES, 0)
    (tmp_path / "hands.jsonl").write_text('{"format": "cell.hands"}\n{"file": 3}\n')
    with pytest.raises(InputError, match=r"hands\.jsonl:2"):
        load_hands([tmp_path], SETUP, TYPES, 0)


@pytest.mark.parametrize(
    ("network", "file", "kind", "shapes"),
    [
        (Finder, "hands_slim_finder.onnx", FINDER_KIND, {"image": (1, 3, 120, 160)}),
        (
            lambda: Reader(3),
            "hands_slim.onnx",
            READER_KIND,
            {"region": (2, 3, 128, 128), "around": (2, 3, 96, 96), "place": (2, 2)},
        ),
        (Refiner, "hands_slim_refiner.onnx", REFINER_KIND, {"closeup": (2, 3, 96, 96), "place": (2, 2)}),
    ],
)
def test_what_begins_with_weights_answers_as_they_do(
    network: Callable[[], Any], file: str, kind: str, shapes: dict[str, tuple[int, ...]]
) -> None:
    begun = network()
    begin_with(begun, WEIGHTS / file, kind)
    rng = np.random.default_rng(0)
    inputs = {name: rng.random(shape, dtype=np.float32) for name, shape in shapes.items()}
    shipped = OnnxModel.load(WEIGHTS / file, kind).run(inputs)
    with torch.no_grad():
        answer = begun(*(torch.from_numpy(input_) for input_ in inputs.values()))
    for name, value in answer._asdict().items():
        assert np.abs(value.numpy() - shipped[name]).max() < 1e-4, name


def test_weights_of_another_network_are_no_beginning() -> None:
    with pytest.raises(ModelError, match=r"hands\.slim"):
        begin_with(Finder(), WEIGHTS / "hands_slim.onnx", FINDER_KIND)
    with pytest.raises(ModelError, match=r"holds no facts\.2\.weight of \(18, 192\)"):
        begin_with(Reader(4), WEIGHTS / "hands_slim.onnx", READER_KIND)
