"""Drawn scenes: repeatable, possible, and different from split to split."""

from __future__ import annotations

import math

import numpy as np

from bracket_cell.learned.grasp.boxes import bodies_overlap
from bracket_cell.learned.grasp.settings import SceneSettings
from bracket_lab.learned.grasp.graph import MAX_PARTS, edge_weights, feature_count, scene_graph
from bracket_lab.learned.grasp.scenes import data_hash, draw_scenes
from tests.learned.grasp.layouts import PRODUCT, moved, standing


def test_scene_k_is_the_same_however_many_are_drawn() -> None:
    few, many = list(draw_scenes(PRODUCT, 4, 3, "train")), list(draw_scenes(PRODUCT, 4, 6, "train"))
    assert data_hash(few) == data_hash(many[:3])
    assert data_hash(few) != data_hash(list(draw_scenes(PRODUCT, 5, 3, "train")))


def test_splits_share_no_scene() -> None:
    train, test = (list(draw_scenes(PRODUCT, 4, 20, split)) for split in ("train", "test"))
    seen = {scene.boxes.centre_m.tobytes() for scene in train}
    assert not seen & {scene.boxes.centre_m.tobytes() for scene in test}


def test_bodies_stand_apart_inside_the_tray() -> None:
    settings = SceneSettings()
    for scene in draw_scenes(PRODUCT, 6, 50, "validation", settings):
        overlap = bodies_overlap(scene.boxes, scene.boxes, 0.0)
        assert overlap.sum() == len(scene.boxes)
        assert np.all(np.abs(scene.boxes.centre_m) < np.array(settings.tray_m) / 2)


def test_detections_are_near_the_truth() -> None:
    settings = SceneSettings()
    for scene in draw_scenes(PRODUCT, 8, 20, "test", settings):
        for index, part in enumerate(scene.parts):
            assert part.part == scene.boxes.types[index]
            error = np.array(part.world_from_part.position_m[:2]) - scene.boxes.centre_m[index]
            assert np.all(np.abs(error) < 6 * settings.noise.position_m)
            turn = part.world_from_part.yaw_rad - scene.boxes.yaw_rad[index]
            assert abs(math.sin(turn)) < 6 * settings.noise.yaw_rad


def test_scenes_hold_every_kind_of_answer() -> None:
    texts = {
        scene.solution(i).text.split(" ")[0]
        for scene in draw_scenes(PRODUCT, 1, 100, "train")
        for i in range(len(scene.boxes))
    }
    assert texts == {"grasp", "move", "help"}


def test_normalised_weights_sum_to_one_and_favour_the_near() -> None:
    centres = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 3.0]])
    weights = edge_weights(centres)
    assert np.allclose(weights.sum(axis=1), 1.0)
    assert np.allclose(weights[0], [0.0, 0.75, 0.25])
    assert edge_weights(np.zeros((1, 2))).tolist() == [[0.0]]


def test_the_graph_says_what_is_required_and_where_it_stands() -> None:
    parts = (standing("o1", 0.1, 0.0, 0.3), standing("o2", 0.15, 0.02, 1.0), standing("o3", 0.05, -0.06, 2.0))
    graph = scene_graph(parts, (1, 2), PRODUCT)
    kinds = len(PRODUCT.parts)
    assert graph.order[0] == 1
    assert [graph.order[place] for place in np.flatnonzero(graph.nodes[:, kinds])] == [1, 2]
    shifted = scene_graph(tuple(moved(part, 0.3, -0.2, 0.0) for part in parts), (1, 2), PRODUCT)
    assert np.allclose(graph.nodes, shifted.nodes, atol=1e-5)
    turned = scene_graph(tuple(moved(part, 0.0, 0.0, 0.7) for part in parts), (1, 2), PRODUCT)
    assert np.allclose(graph.weights, turned.weights, atol=1e-5)
    place = graph.nodes[:3, kinds + 1 : kinds + 3] @ [[math.cos(0.7), math.sin(0.7)], [-math.sin(0.7), math.cos(0.7)]]
    assert np.allclose(turned.nodes[:3, kinds + 1 : kinds + 3], place, atol=1e-5)


def test_the_graph_keeps_the_nearest_parts() -> None:
    parts = tuple(standing("o1", 0.1 * index, 0.0) for index in range(MAX_PARTS + 2))
    graph = scene_graph(parts, (0,), PRODUCT)
    assert graph.order == tuple(range(MAX_PARTS))
    assert graph.nodes.shape == (MAX_PARTS, feature_count(PRODUCT))
