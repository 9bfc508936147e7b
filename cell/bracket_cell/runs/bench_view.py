"""The bench from above: what each camera sees of it, what the arm reaches, and what is cut off."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.bench_evidence import leaves_in_view
from bracket_cell.runs.calibrating import DOWN
from bracket_cell.runs.hand_rest import rest_advice
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.motion.resting import with_resting_poses
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_cell.wiring.bench_checks import in_view
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

Marks = NDArray[np.bool_]
STEPS = 7  # places along each side of the tray that are tried
QUARTERS = 4  # turns of the gripper that are tried at each
SLOW = 1.5  # times the median time at full speed from where the arm looks
GRASP_M = 0.06  # of the tool over the floor of the tray, above parts that stand
PIXELS_PER_M, MARGIN_M = 600.0, 0.1
EDGE_POINTS = 12  # along each side of an image
SIDES = {(0, -1): "left", (0, 1): "right", (1, -1): "far", (1, 1): "near"}  # of the tray, as the person sees it


class BenchView:
    """Looks at the bench of a configuration; nothing is opened.

    Attributes:
        problems: what is cut off or out of reach, in words.
        told: what is well, in words.
    """

    def __init__(self, bench: Bench, product: Product, motion: MotionPlanner) -> None:
        self._bench, self._product, self._motion = bench, product, motion
        self.problems: list[str] = []
        self.remarks: list[str] = []
        try:
            found = with_resting_poses(bench, product, motion.settings, leaves_in_view(bench, product)).arm_look_rad
        except ValueError as error:
            self.problems.append(str(error))
            found = bench.arm_look_rad or tuple(motion.kinematics.usual_rad.tolist())
        self._look = np.array(found)
        self._judge()

    @cached_property
    def _tray(self) -> Array:
        """Places (STEPS, STEPS, 3) on the floor of the tray, from its rim on."""
        x_m, y_m = self._bench.tray.size_m
        x, y = np.meshgrid(np.linspace(-x_m / 2, x_m / 2, STEPS), np.linspace(-y_m / 2, y_m / 2, STEPS), indexing="ij")
        return np.array(self._bench.tray.centre_m) + np.stack([x, y, np.zeros_like(x)], axis=-1)

    @cached_property
    def _wrist(self) -> Pose:
        """world_from_camera of the wrist camera at the look pose."""
        return self._motion.kinematics.forward(self._look) @ self._bench.wrist.mount.pose

    @cached_property
    def _times_s(self) -> Array:
        """(STEPS, STEPS) how soon the arm is over each place of the tray from where it looks; inf: out of reach."""
        return np.array([[self._time_s(place) for place in row] for row in self._tray])

    @property
    def _reached(self) -> Marks:
        """Which places of the tray the fingers reach, (STEPS, STEPS)."""
        return np.isfinite(self._times_s)

    @cached_property
    def _holes_s(self) -> dict[str, float]:
        """The same of the holes of the bracket, by name."""
        pose = self._bench.bracket.pose
        return {
            name: self._time_s(pose.transform(np.array([*at, 0.0])))
            for name, at in self._product.bracket.holes_m.items()
        }

    def _time_s(self, place_m: Array) -> float:
        joints_rad = self._joints_rad(place_m)
        return float("inf") if joints_rad is None else self._motion.travel_s(joints_rad - self._look)

    @property
    def rest_advice(self) -> str:
        """Where the person's hand would better rest; empty where it is out of the way."""
        return rest_advice(self._motion, self._bench, self._ways_rad)

    @cached_property
    def _ways_rad(self) -> list[Array]:
        """From the tray's middle to each hole that is reached, (2, n)."""
        pose, middle = self._bench.bracket.pose, self._joints_rad(np.array(self._bench.tray.centre_m))
        holes = (pose.transform(np.array([*at, 0.0])) for at in self._product.bracket.holes_m.values())
        ends = [self._joints_rad(hole) for hole in holes]
        return [np.array([middle, end]) for end in ends if middle is not None and end is not None]

    @property
    def _cost(self) -> str:
        """What the layout costs: mean times of a part's ways, each from rest to rest; empty where none is reached."""
        stops = [(self._look, *way, self._look) for way in self._ways_rad]
        if not stops:
            return ""
        times = [[joint_move(*leg, self._motion.settings).duration_s for leg in pairwise(part)] for part in stops]
        to_s, on_s, back_s = np.mean(times, axis=0)
        ways = f"{to_s:.1f} s to the tray, {on_s:.1f} s to the holes, {back_s:.1f} s back"
        return f"a part costs {to_s + on_s + back_s:.1f} s of ways: {ways}"

    def _joints_rad(self, place_m: Array) -> Array | None:
        """Joints (n,) with the fingers over a place; None out of reach."""
        x, y, z = (float(value) for value in place_m)
        if self._motion.kinematics.too_far(place_m):
            return None
        turns = [quarter * np.pi / 2 for quarter in range(QUARTERS)]
        poses = [Pose.from_yaw((x, y, z + GRASP_M), turn) @ DOWN for turn in turns]
        found = self._motion.reach(poses, self._look, Load(self._motion.open_m))
        return None if isinstance(found, str) else found[1]

    def _judge(self) -> None:
        bench = self._bench
        tray, inside = self._tray.reshape(-1, 3), slice(1, -1)
        self._cut_off(in_view(bench.wrist, self._wrist, tray))
        inner = self._reached[inside, inside]
        if inner.all():
            self.remarks.append("the arm reaches all of the tray but its rim")
        else:
            self.problems.append(
                f"the arm does not reach {(~inner).mean():.0%} of the tray: move it, or the arm's base"
            )
        self._judge_holes()
        self._judge_times(inner, self._times_s[inside, inside])
        overhead = bench.overhead.mount.pose
        holes = {f"hole {name}": bench.bracket.pose.transform(np.array([*at, 0.0]))
                 for name, at in self._product.bracket.holes_m.items()}  # fmt: skip
        places = {**holes, **{f"bin {name}": np.array(at) for name, at in bench.bins_m.items()}}
        seen = in_view(bench.overhead, overhead, np.array(list(places.values())))
        hidden = [name for name, sees in zip(places, seen, strict=True) if not sees]
        if hidden:
            self.problems.append(f"the overhead camera does not see {', '.join(hidden)}: hang it higher, or elsewhere")
        else:
            self.remarks.append("the overhead camera sees all holes and bins")

    def _judge_holes(self) -> None:
        far = [name for name, time_s in self._holes_s.items() if np.isinf(time_s)]
        if far:
            self.problems.append(f"the arm does not reach {', '.join(far)}: move the bracket, or the arm's base")
        else:
            self.remarks.append("the arm reaches all holes")

    def _judge_times(self, reached: Marks, times_s: Array) -> None:
        """Where the arm takes much longer than elsewhere: in a corner of the tray, or at a hole."""
        corners = {f"the tray's {SIDES[1, x]} {SIDES[0, y]} corner": float(times_s[min(-x, 0), min(-y, 0)])
                   for x in (-1, 1) for y in (-1, 1)}  # fmt: skip
        holes = {f"hole {name}": time_s for name, time_s in self._holes_s.items()}
        usual_s = float(np.median(times_s[reached])) if reached.any() else np.inf
        late = [*_late(corners, usual_s), *_late(holes, float(np.median([*holes.values()] or [np.inf])))]
        self.remarks.append(f"slow: {', '.join(late)}" if late else "no corner and no hole is much slower than others")
        self.remarks += [self._cost] * bool(self._cost)

    def _cut_off(self, seen: Marks) -> None:
        grid = seen.reshape(STEPS, STEPS)
        if grid.all():
            self.remarks.append("the wrist camera sees the whole tray")
            return
        lines = {(1, -1): grid[0], (1, 1): grid[-1], (0, -1): grid[:, 0], (0, 1): grid[:, -1]}
        sides = [SIDES[side] for side, line in lines.items() if not line.all()]
        share = 1 - float(grid.mean())
        where = ", ".join(sides) or "middle"
        self.problems.append(
            f"the wrist camera does not see the tray's {where} side: about {share:.0%} of the tray is cut off; "
            "`cell setup teach look` from higher up, or move the tray"
        )

    @cached_property
    def svg(self) -> str:
        """The drawing: x to the bottom, as the person sees the bench, y to the right."""
        bench, shapes = self._bench, list[str]()
        for setup, pose, colour in (
            (bench.overhead, bench.overhead.mount.pose, "#1f77b4"),
            (bench.wrist, self._wrist, "#2ca02c"),
        ):
            shapes.append(_polygon(_footprint(setup, pose), f'fill="{colour}" fill-opacity="0.12" stroke="{colour}"'))
        corners = self._tray[[0, 0, -1, -1], [0, -1, -1, 0]]
        shapes.append(_polygon(corners, 'fill="none" stroke="#444"'))
        reached = self._reached
        for place, can in zip(self._tray.reshape(-1, 3), reached.ravel(), strict=True):
            shapes.append(_circle(place, 0.006, "#2ca02c" if can else "#d62728"))
        for name, at in self._product.bracket.holes_m.items():
            place = bench.bracket.pose.transform(np.array([*at, 0.0]))
            colour = "#888" if np.isfinite(self._holes_s[name]) else "#d62728"
            shapes += [_circle(place, 0.01, colour), _text(place, name)]
        for name, middle in bench.bins_m.items():
            shapes += [_circle(np.array(middle), 0.03, "#ddd"), _text(np.array(middle), f"bin {name}")]
        shapes += [_circle(np.zeros(3), 0.08, "#bbb"), _text(np.zeros(3), "arm")]
        return _document(shapes, np.concatenate([corners, _footprint(bench.overhead, bench.overhead.mount.pose)]))


def _late(times_s: Mapping[str, float], usual_s: float) -> list[str]:
    """Places that take much longer than is usual, in words; those out of reach are said elsewhere."""
    return [f"{name} {time_s:.1f} s, usual {usual_s:.1f} s" for name, time_s in times_s.items()
            if SLOW * usual_s < time_s < np.inf]  # fmt: skip


def _footprint(setup: CameraSetup, world_from_camera: Pose) -> Array:
    """Outline (n, 3) of what a camera sees of the table."""
    right, bottom = setup.width_px - 1.0, setup.height_px - 1.0
    corners = np.array([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom], [0.0, 0.0]])
    along = np.linspace(0, 1, EDGE_POINTS, endpoint=False)[:, np.newaxis]
    pixels = np.concatenate([first + along * (last - first) for first, last in pairwise(corners)])
    return setup.model.onto_plane(world_from_camera, pixels, 0.0)


def _at(place_m: Array) -> str:
    return f"{PIXELS_PER_M * place_m[1]:.1f},{PIXELS_PER_M * place_m[0]:.1f}"


def _polygon(places_m: Array, style: str) -> str:
    return f'<polygon points="{" ".join(_at(place) for place in places_m)}" {style}/>'


def _circle(place_m: Array, radius_m: float, colour: str) -> str:
    y, x = _at(place_m).split(",")
    return f'<circle cx="{y}" cy="{x}" r="{PIXELS_PER_M * radius_m:.1f}" fill="{colour}"/>'


def _text(place_m: Array, text: str) -> str:
    y, x = _at(place_m).split(",")
    return f'<text x="{y}" y="{x}" font-size="14" text-anchor="middle" font-family="sans-serif">{text}</text>'


def _document(shapes: list[str], places_m: Array) -> str:
    low = np.minimum(places_m.min(axis=0), 0.0)[:2] - MARGIN_M
    size = np.maximum(places_m.max(axis=0), 0.0)[:2] + MARGIN_M - low
    box = " ".join(f"{PIXELS_PER_M * value:.0f}" for value in (low[1], low[0], size[1], size[0]))
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">\n' + "\n".join(shapes) + "\n</svg>\n"
