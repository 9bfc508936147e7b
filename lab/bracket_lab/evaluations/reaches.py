"""Ergonomics of the person's hand, from its way: what it reaches for, how far from the shoulder, and how high.

A reach is a movement between two rests of the palm that ends at least REACH_M from where it began. Trunk and elbow are
not seen: the shoulder is taken to be where it is in somebody who sits upright with the hand at its resting place.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from bracket_cell.configuration import DEFAULT_TREE, Configuration, load_faults
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import run_controller
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.wiring.devices import attached
from bracket_cell.wiring.services import load_planners
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.recording import Assembly, Film, drawn_goal, record
from bracket_lab.learned.scores import student
from bracket_sim.cell import SimCell
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.rendering.camera import SimCamera
from bracket_sim.scene.settings import settings_of


def record_beside_robot(configuration: Configuration, product: Product, seed: int) -> Assembly:
    """One bracket that person and robot build together, by physics; look, goal and person are drawn from the seed.

    The controller knows hands, holes and parts from the truth: frames are made later, and only those that are wanted.
    """
    bench, bus, goal = configuration.bench, configuration.devices.gripper_bus, drawn_goal(product, seed)
    motion = MotionPlanner(product, bench, configuration.motion)
    tree = load_tree(DEFAULT_TREE, node_registry())
    files = Files(configuration, product, tree, load_planners(configuration, product), load_faults(configuration))
    settings = settings_of(configuration.devices.simulation)
    cell = SimCell(product, bench, settings, *bus, seed, goal, rendered=False, robot=configuration.robot)
    with closing(cell):
        film, camera, worker = Film(cell.world), cell.devices.overhead, cell.worker
        assert isinstance(camera, SimCamera)
        assert worker is not None
        camera.watch = film.keep
        with attached(configuration, product, without_pixels(cell, configuration, product)) as devices:
            outcome = run_controller(files, devices, motion)
        if outcome.end == "interrupted":  # the controller heard the signal, and ended the run safely
            raise KeyboardInterrupt(outcome.reason)
        return film.assembly(seed, goal, cell.look, worker.events, worker.acts, robot_works=True)


BEHIND_M, ABOVE_M = 0.36, 0.36  # shoulder behind the resting palm, above the table: ISO 7250-1 (elbow-grip length;
# shoulder less elbow height, sitting), with the elbow at the height of the table as ISO 14738 has it
MOVES_M_S = 0.15  # a palm that is slower rests
SHORTEST_S = 0.2  # a shorter rest is a part of the reach
REACH_M = 0.15
AT_M = 0.10  # as near to a place the fingertips reach for it


@dataclass(frozen=True)
class HandWay:
    """Where one hand was, over n moments in which it was seen: time_s (n,), palm_m (n, 3), fingertips_m (n, 2)."""

    time_s: Array
    palm_m: Array
    fingertips_m: Array

    @classmethod
    def of_views(cls, views: Iterable[BenchView]) -> HandWay:
        """As a detector saw it, without the moments whose height it could not tell.

        Raises:
            InputError: it saw no hand, or one of no known height.
        """
        seen = {
            view.time_s: (hand.palm_m, hand.height_m, hand.fingertips_m)
            for view in views
            if (hand := view.hand) is not None and hand.height_m is not None
        }
        if not seen:
            raise InputError("no hand of known height was seen")
        palm, height, tips = zip(*seen.values(), strict=True)
        return cls(np.array(list(seen)), np.column_stack([palm, height]), np.array(tips))

    @classmethod
    def of_recording(cls, assembly: Assembly) -> HandWay:
        """As it truly was."""
        columns = zip(
            *((moment.time_s, moment.palm_m, moment.fingertips_m[:2]) for moment in assembly.moments), strict=True
        )
        return cls(*(np.array(column) for column in columns))

    def reaches(self) -> list[tuple[int, int]]:
        """First and last moment of each."""
        way_m = np.linalg.norm(np.diff(self.palm_m, axis=0), axis=1)
        moves = way_m / np.diff(self.time_s) > MOVES_M_S
        edges = np.flatnonzero(np.diff(np.concatenate([[False], moves, [False]]).astype(int)))
        joined: list[tuple[int, int]] = []
        for first, last in edges.reshape(-1, 2).tolist():
            if joined and self.time_s[first] - self.time_s[joined[-1][1]] < SHORTEST_S:
                first = joined.pop()[0]
            joined.append((first, last))
        return [ends for ends in joined if np.linalg.norm(np.subtract(*self.palm_m[list(ends)])) >= REACH_M]


def ergonomics(way: HandWay, bench: Bench, product: Product) -> dict[str, Any]:
    """Figures of one bracket: reaches with their places, metres, and the share of the time above the shoulder."""
    rest = np.array(bench.hand_rest_m)
    shoulder_m = np.array([rest[0] + BEHIND_M, rest[1], ABOVE_M])
    ends = [last for _, last in way.reaches()]
    away_m = np.linalg.norm(way.palm_m[ends] - shoulder_m, axis=1)
    places = Counter(_place(way.fingertips_m[end], way.palm_m[end], bench, product) for end in ends)
    return {
        "time_s": round(float(way.time_s[-1] - way.time_s[0]), 2),
        "reaches": len(ends),
        "reach_m": round(float(away_m.mean()), 3) if ends else 0.0,
        "farthest_m": round(float(away_m.max()), 3) if ends else 0.0,
        "way_m": round(float(np.linalg.norm(np.diff(way.palm_m, axis=0), axis=1).sum()), 2),
        "above_shoulder": round(float((way.palm_m[:, 2] > ABOVE_M).mean()), 4),
        "places": dict(places.most_common()),
    }


def _place(tips_m: Array, palm_m: Array, bench: Bench, product: Product) -> str:
    """What a reach that ends there is for."""
    holes = bench.bracket.pose.transform(np.array([[*hole, 0.0] for hole in product.bracket.holes_m.values()]))
    places = {f"bin of {name}": np.array(place[:2]) for name, place in bench.bins_m.items()}
    places |= {f"bracket, {number}": hole for number, hole in enumerate(holes[:, :2])}
    nearest = min(places, key=lambda name: float(np.linalg.norm(places[name] - tips_m)))
    if np.linalg.norm(places[nearest] - tips_m) < AT_M:
        return nearest.partition(",")[0]
    if (np.abs(tips_m - np.array(bench.tray.centre_m[:2])) < np.array(bench.tray.size_m) / 2).all():
        return "tray"
    return "rest" if np.linalg.norm(palm_m[:2] - np.array(bench.hand_rest_m[:2])) < AT_M else "elsewhere"


def pair(configuration: Configuration, product: Product, seed: int) -> dict[str, Any]:
    """The same person builds the same bracket beside the robot, and alone; from the truth, nothing is rendered."""
    made = {
        "beside": record_beside_robot(configuration, product, seed),
        "alone": record(product, configuration.bench, settings_of(configuration.devices.simulation), seed),
    }
    found = {
        name: ergonomics(HandWay.of_recording(assembly), configuration.bench, product)
        for name, assembly in made.items()
    }
    return {"seed": seed, **found}


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means of both ways to build a bracket, and of what the robot spares, with Student's interval over pairs."""
    found: dict[str, Any] = {"n": len(rows)}
    for name in ("time_s", "reaches", "reach_m", "farthest_m", "way_m", "above_shoulder"):
        values = {how: [float(row[how][name]) for row in rows] for how in ("alone", "beside")}
        values["spared"] = [alone - beside for alone, beside in zip(values["alone"], values["beside"], strict=True)]
        for how, numbers in values.items():
            mean, half = student(numbers)
            low = mean - half if how == "spared" else max(0.0, mean - half)
            found |= {f"{name}_{how}": mean, f"{name}_{how}_low": low, f"{name}_{how}_high": mean + half}
    places = [sum((Counter(row[how]["places"]) for row in rows), Counter()) for how in ("alone", "beside")]
    return {**found, "places_alone": dict(places[0]), "places_beside": dict(places[1])}
