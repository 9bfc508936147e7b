"""Planners of stacks: laws of their networks, and that each kind learns what its features tell."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch

from bracket_ground.interfaces.stacks import VMRD_CLASSES
from bracket_lab.experiments.stacks.batches import CHILD, FATHER, NOTHING, answers_of, batch_of, pair_geometry
from bracket_lab.experiments.stacks.checks import Kind, StackTraining
from bracket_lab.experiments.stacks.experiment import alike
from bracket_lab.experiments.stacks.networks import GvmrnRf, PointerNet, Vmrn
from bracket_lab.experiments.stacks.planners import Always, Topmost, train_planner
from bracket_lab.experiments.stacks.scores import Seen, ious, names_what_lies_on, score
from bracket_lab.experiments.stacks.views import Labelled, StackView, _read, _write, labelled
from bracket_lab.learned.training.schedule import Schedule
from tests.learned.stacks.made_up import scene

pytestmark = [pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning:torch.*")]
WIDTH = 6


def example(seed: int) -> Labelled:
    """A scene whose unions' features say whether the left one of two is on top; regions' first feature is how left."""
    drawn = scene(seed)
    boxes = np.array([item.box_px for item in drawn.objects]) / (480, 360, 480, 360)
    count = len(boxes)
    unions = np.zeros((count, count, WIDTH), np.float16)
    for i, j in combinations(range(count), 2):
        first, second = (i, j) if boxes[i, 0] < boxes[j, 0] else (j, i)
        lies = drawn.objects[second].index in drawn.objects[first].children
        carries = drawn.objects[first].index in drawn.objects[second].children
        unions[i, j, :3] = unions[j, i, :3] = (lies, carries, not (lies or carries))
    regions = np.random.default_rng(seed).normal(size=(count, WIDTH)).astype(np.float16)
    regions[:, 0] = 6 * boxes[:, 0] - 2
    tops = np.array([item.top_m for item in drawn.objects], dtype=float)
    names = tuple(item.name for item in drawn.objects)
    return labelled(drawn, StackView(names, boxes, regions, 3 * unions, tops))


TAUGHT = [example(seed) for seed in range(160)]
ASKED = [Seen(labelled_frame, labelled_frame.view) for labelled_frame in (example(seed) for seed in range(900, 940))]


def test_the_relation_of_a_pair_is_the_other_ones_turned_round() -> None:
    relations = answers_of(TAUGHT[:20]).relations.numpy()
    turned = np.select([relations == FATHER, relations == CHILD], [CHILD, FATHER], NOTHING)
    assert (relations.transpose(0, 2, 1) == turned).all()
    assert (relations == FATHER).any()


@pytest.mark.parametrize("kind", [Vmrn, GvmrnRf])
def test_both_orders_of_a_pair_agree(kind: type[Vmrn | GvmrnRf]) -> None:
    torch.manual_seed(0)
    network = kind(WIDTH, 16).eval()
    answer = network(batch_of([TAUGHT[3].view], VMRD_CLASSES))
    logits = answer[0] if isinstance(answer, tuple) else answer
    assert torch.allclose(logits[..., FATHER], logits[..., CHILD].transpose(1, 2), atol=1e-5)
    assert torch.allclose(logits[..., NOTHING], logits[..., NOTHING].transpose(1, 2), atol=1e-5)


def test_the_order_of_nodes_means_nothing_to_the_default() -> None:
    torch.manual_seed(0)
    network = PointerNet(WIDTH, len(VMRD_CLASSES)).eval()
    view = next(labelled_frame.view for labelled_frame in TAUGHT if len(labelled_frame.view.names) == 4)
    order = [2, 0, 3, 1]
    names = tuple(view.names[one] for one in order)
    turned = StackView(names, view.boxes[order], view.regions[order], view.unions[np.ix_(order, order)])
    verdicts, words = network(batch_of([view], VMRD_CLASSES))
    turned_verdicts, turned_words = network(batch_of([turned], VMRD_CLASSES))
    assert torch.allclose(verdicts[0, order], turned_verdicts[0], atol=1e-5)
    place = {old: new for new, old in enumerate(order)} | {4: 4}
    for new, old in enumerate(order):
        assert [place[word] for word in words[0, old].tolist()] == turned_words[0, new].tolist()


def test_padding_changes_nothing() -> None:
    torch.manual_seed(0)
    network = PointerNet(WIDTH, len(VMRD_CLASSES)).eval()
    small = next(labelled_frame.view for labelled_frame in TAUGHT if len(labelled_frame.view.names) == 2)
    large = next(labelled_frame.view for labelled_frame in TAUGHT if len(labelled_frame.view.names) == 5)
    alone, _ = network(batch_of([small], VMRD_CLASSES))
    beside, _ = network(batch_of([small, large], VMRD_CLASSES))
    assert torch.allclose(alone[0], beside[0, :2], atol=1e-5)


SLOW = [pytest.param(kind, 12, marks=pytest.mark.slow) for kind in ("vmrn", "gvmrn_rf")]


@pytest.mark.long
@pytest.mark.parametrize(("kind", "epochs"), [("default", 6), *SLOW])
def test_each_kind_learns_who_lies_on_whom(kind: Kind, epochs: int) -> None:
    settings = StackTraining(share=0.05, heads=Schedule(epochs=epochs, batch=8, peak_rate=3e-3))
    found = score(train_planner(kind, TAUGHT, 1, settings), ASKED)
    assert found["OR"] > 0.85
    assert found["graph"] > score(Always(), ASKED)["graph"] + 0.1


def test_the_papers_planner_learns_to_say_something() -> None:
    settings = StackTraining(heads=Schedule(epochs=2, batch=16))
    planner = train_planner("paper", TAUGHT[:60], 1, settings)
    plan = planner.plan(TAUGHT[0].view, 0)
    assert plan.text == "grasp" or plan.text.startswith("move ") or plan.needs_help


def test_scores_of_the_truth_are_one() -> None:
    class Truth(Always):
        def relations(self, view: StackView) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
            return next(one.truth.children for one in ASKED if one.view is view)

    found = score(Truth(), ASKED)
    assert [found[name] for name in ("OR", "OP", "IA", "answer", "graph", "decoder")] == [1.0] * 6


def test_a_false_detection_costs_precision_and_the_picture() -> None:
    one = ASKED[0]
    view = one.view
    seen = StackView((*view.names, "box"), np.vstack([view.boxes, [[0.9, 0.9, 0.99, 0.99]]]), view.regions, view.unions)
    exact = [Seen(one.truth, replace(view))]
    assert score(Always(), exact)["OR"] == score(Always(), [one])["OR"]
    found = score(Always(), [Seen(one.truth, seen)])
    assert found["OR"] == score(Always(), exact)["OR"]
    assert found["OP"] < score(Always(), exact)["OP"]
    assert found["IA"] == 0.0


def test_a_text_must_name_all_that_lies_on_it_topmost_first() -> None:
    one = next(one.truth for one in ASKED if one.truth.above.sum(axis=1).max() >= 2)
    wanted = int(one.above.sum(axis=1).argmax())
    above = sorted(np.flatnonzero(one.above[wanted]).tolist(), key=lambda each: int(one.above[each].sum()))
    names = [one.view.names[each] for each in above]
    assert names_what_lies_on(f"move {' and '.join(names)}", one, wanted)
    assert not names_what_lies_on(f"move {' and '.join(names[:-1])}", one, wanted)
    assert not names_what_lies_on("grasp", one, wanted)
    chain = next((each for each in above if one.above[each].any()), None)
    assert chain is None or not names_what_lies_on(f"move {' and '.join(names[::-1])}", one, wanted)


def test_topmost_needs_overlap_and_height() -> None:
    boxes = np.array([[0.1, 0.1, 0.5, 0.5], [0.2, 0.2, 0.4, 0.4], [0.8, 0.8, 0.9, 0.9]])
    features = np.zeros((3, 1), np.float16), np.zeros((3, 3, 1), np.float16)
    view = StackView(("box", "cup", "pen"), boxes, *features, np.array([0.02, 0.1, 0.3]))
    assert Topmost().relations(view).tolist() == [[False, True, False], [False] * 3, [False] * 3]
    assert Topmost().plan(view, 0).text == "move cup"
    assert Topmost().plan(view, 1).graspable == 1.0


def test_shares_of_boxes() -> None:
    first, second = np.array([[0.0, 0.0, 2.0, 2.0]]), np.array([[1.0, 0.0, 3.0, 2.0], [0.0, 0.0, 2.0, 2.0]])
    assert ious(first, second).round(3).tolist() == [[0.333, 1.0]]
    assert pair_geometry(second)[0, 1, 4:7].round(3).tolist() == [0.5, 0.5, 0.333]


def test_views_are_read_as_they_were_written(tmp_path: Path) -> None:
    empty = StackView((), np.zeros((0, 4)), np.zeros((0, WIDTH), np.float16), np.zeros((0, 0, WIDTH), np.float16))
    views = [TAUGHT[0].view, empty, TAUGHT[1].view]
    _write(tmp_path / "views.npz", views)
    for view, other in zip(views, _read(tmp_path / "views.npz"), strict=True):
        assert view.names == other.names
        assert np.array_equal(view.unions, other.unions)
        assert np.array_equal(view.regions, other.regions)


def test_numbers_of_classes_are_compared_on_alike_pictures() -> None:
    chosen = alike({5: ASKED[:10], 31: ASKED}, 0)
    sizes = {key: sorted(len(one.view.names) for one in some) for key, some in chosen.items()}
    assert sizes[5] == sizes[31] == sorted(len(one.view.names) for one in ASKED[:10])
