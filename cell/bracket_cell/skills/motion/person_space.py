"""Where people may be, as convex bodies over the bench: hands that are seen, and hands beyond the edges of the view."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import coal
import numpy as np

from bracket_cell.skills.motion.known_bench import EDGES, KnownBench, ViewRange
from bracket_cell.skills.motion.settings import SeparationSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import WRIST_BENDS_RAD, Edge, HandSample
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class PersonLimits:
    """How large a person's hands are, and where they may be. Origin: chosen, wider than bodies (DIN 33402-2).

    Attributes:
        edge_px: [px] from the image's edge at which a box touches it.
        hand_length_m: [m] from palm to fingertips where a tracker does not report it.
        least_length_m: [m] from fingertips to palm; a hand that is shorter in the image points nowhere.
        knuckles_m: [m] above palm and fingertips that hand and forearm reach, and error of their heights.
        beyond_m: [m] that a hand that left the view may have gone.
        reach_m: [m] that a small person's palm is before their chest; who reaches farther over the bench leans in.
        head_m: [m] that a head is before the chest of who leans.
        aside_m: [m] that head and shoulders are beside the line of a hand.
        tall_m: [m] over a bench of 0.75 m that a tall person's head reaches.
    """

    edge_px: int = 6
    hand_length_m: float = 0.12
    least_length_m: float = 0.03
    knuckles_m: float = 0.15
    beyond_m: float = 1.0
    reach_m: float = 0.35
    head_m: float = 0.10
    aside_m: float = 0.30
    tall_m: float = 1.1


PERSON = PersonLimits()


HANDS = 2  # of a person; those that are not seen may come over the person's edge
TINY_M = 1e-9
FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


@dataclass(frozen=True)
class Person:
    """A hand with its forearm, or a place where one may be.

    Attributes:
        body: all places that it may be at, with the intrusion distance C.
        age_s: of what is known of it.
        hand_speed_m_s: v_h, where it is not measured.
        velocity_m_s: (x, y) as measured, the mean of a while; None where that is unknown.
        acceleration_m_s2: (x, y) as measured; None where that is unknown: then it was even, from rest.
        waited_for: an arm that is too near waits for it to leave.
        doubt_m: by how much more than Z_d of the settings it may be off, by the deviation that its tracker tells.
    """

    body: coal.Convex
    age_s: float
    hand_speed_m_s: float
    velocity_m_s: tuple[float, float] | None = None
    acceleration_m_s2: tuple[float, float] | None = None
    waited_for: bool = True
    doubt_m: float = 0.0

    def coming_m_s(self, ways: Array, next_s: float = 0.0, last_s: float = 0.0) -> Array:
        """How fast it comes nearer along each of the ways (..., 3): at least at half of its speed, as it may turn.

        Args:
            next_s: for so long it goes on to speed up, as far as hands do; the mean speed of that is meant.
            last_s: what the measured velocity is a mean over.
        """
        if self.velocity_m_s is None:
            return np.full(ways.shape[:-1], self.hand_speed_m_s)
        velocity, later_s = np.array(self.velocity_m_s), (last_s + next_s) / 2
        speed, towards = _towards(velocity, ways)
        if self.acceleration_m_s2 is not None:
            towards = towards + later_s * _towards(np.array(self.acceleration_m_s2), ways)[1].clip(0.0)
        elif last_s > 0:
            towards = towards * (1 + 2 * later_s / last_s)
        coming: Array = np.clip(towards, speed / 2, max(self.hand_speed_m_s, speed))
        return coming

    def most_m_s(self, next_s: float = 0.0, last_s: float = 0.0) -> float:
        """Bound of `coming_m_s`, whatever the way."""
        if self.velocity_m_s is None:
            return self.hand_speed_m_s
        speed, later_s = self._speed_m_s, (last_s + next_s) / 2
        if self.acceleration_m_s2 is not None:
            most = speed + later_s * float(np.linalg.norm(np.array(self.acceleration_m_s2)))
        else:
            most = speed * (1 + 2 * later_s / last_s) if last_s > 0 else speed
        return min(most, max(self.hand_speed_m_s, speed))

    def works(self, most_m_s: float) -> bool:
        """Whether it is seen to stay where it is: no faster than that."""
        return self.velocity_m_s is not None and self._speed_m_s <= most_m_s

    @cached_property
    def _speed_m_s(self) -> float:
        return float(np.linalg.norm(np.array(self.velocity_m_s)))


class PersonSpace:
    """Seen from the overhead camera.

    Attributes:
        view_range: what a tracker can tell of hands.
        beyond: all places beyond an edge of the view that a hand can be at.
        hands: of all people at the bench.
        edge: the edge behind which the person stands: x points towards the person.
    """

    def __init__(self, bench: Bench, settings: SeparationSettings) -> None:
        self._settings, self.view_range, self.hands = settings, ViewRange(bench), HANDS * settings.people
        self._camera, self._world_from_camera = bench.overhead.model, bench.overhead.mount.pose
        self._eye = np.array(bench.overhead.mount.position_m)
        self.beyond = {edge: self._outside(edge) for edge in EDGES}
        self.edge: Edge = max(EDGES, key=self._towards_person)

    def of(self, known: KnownBench) -> list[Person]:
        """Every hand that is seen, its elbow, its head where it leans in, and as many hands beyond the edges as may be.

        A hand that left by an edge may come back anywhere there. Behind the edge where the person stands a hand may
        stay away for long: the arm is slow before it could arrive, but does not wait for it. All hands that are not
        seen may be there, whatever else is seen. And over an edge that the bench leaves open somebody else may come.
        """
        persons = [person for hand in known.hands for person in self._seen(hand, known.age_of_s(hand))]
        edges = {*known.left_by, *self._settings.open_edges, *[self.edge] * (known.count < self.hands)}
        left = {*known.left_by} - {self.edge}
        return persons + [self.behind(edge, known.age_s, left=edge in left) for edge in EDGES if edge in edges]

    def _seen(self, hand: HandSample, age_s: float) -> Iterator[Person]:
        """The hand, and the rest of its person, which is as quick as the hand."""
        doubt_m, speed_m_s = max(0.0, hand.off_m - self._settings.hand_error_m), self._settings.hand_speed_m_s
        seen = Person(self.wall(hand), age_s, speed_m_s, hand.velocity_m_s, hand.acceleration_m_s2, doubt_m=doubt_m)
        for body in (seen.body, *self._rising(hand), *self._leaning(hand)):
            yield replace(seen, body=body)

    def _rising(self, hand: HandSample) -> Iterator[coal.Convex]:
        """The forearm that rises from the palm to the elbow, by up to 45 degrees."""
        if hand.height_m is not None:
            corners = self._footprint(hand, hand.palm_m)
            yield _prism(corners, corners, _top_m(hand) + self._settings.forearm_m * np.array([0.0, 0.0, 1.0, 1.0]))

    def _leaning(self, hand: HandSample) -> Iterator[coal.Convex]:
        """Head and shoulders of whoever reaches from their edge so far over the bench that they must lean in."""
        (first, last), palm_m = self._edge_line(self.edge, 0.0), np.array(hand.palm_m)
        out, along = _outwards(first, last, self._eye[:2]), (last - first) / np.linalg.norm(last - first)
        far_m = float((first - palm_m) @ out)
        if far_m > PERSON.reach_m and (palm_m - hand.fingertips_m) @ out >= 0:
            face = palm_m + (PERSON.reach_m - PERSON.head_m) * out
            aside, behind = PERSON.aside_m * along, (far_m + PERSON.beyond_m) * out
            corners = np.array([face - aside, face + aside, face + aside + behind, face - aside + behind])
            yield _prism(corners, corners, PERSON.tall_m)

    def behind(self, edge: Edge, age_s: float, *, left: bool = False) -> Person:
        """Whoever may be beyond an edge of the view, of which so old a frame is known.

        Args:
            left: a hand was seen to leave there, and may be just behind it: the arm waits for it.
        """
        return Person(self.beyond[edge], age_s, self._settings.hand_speed_m_s, waited_for=left)

    def wall(self, hand: HandSample) -> coal.Convex:
        """A wall over the bench, from the fingertips over the palm along the forearm; C is 0, as the tips are seen."""
        corners, high_m = self._footprint(hand, hand.fingertips_m, self._unseen_m(hand)), self._settings.hand_height_m
        if hand.height_m is not None:
            return _prism(corners, corners, _top_m(hand))
        return _prism(self._at_height(corners, 0.0), self._at_height(corners, high_m), high_m)

    def _footprint(self, hand: HandSample, from_m: tuple[float, float], before_m: float = 0.0) -> Array:
        """Corners (4, 2) along hand and forearm: two so far before a point, and two at the elbow.

        Where the forearm is a guess, the elbow may be as far to either side as wrists bend.
        """
        tips, palm = np.array(hand.fingertips_m), np.array(hand.palm_m)
        along = palm - tips
        length_m = float(np.linalg.norm(along))
        along = along / length_m if length_m > PERSON.least_length_m else np.array([1.0, 0.0])
        across = self._settings.hand_radius_m * np.array([-along[1], along[0]])
        bends = self._settings.forearm_m / self._settings.hand_radius_m * math.sin(WRIST_BENDS_RAD)
        aside = across * (1 + bends * hand.forearm_guessed)
        start = np.array(from_m) - before_m * along
        end = tips + (length_m + self._settings.forearm_m) * along
        return np.array([start - across, start + across, end + aside, end - aside])

    def _unseen_m(self, hand: HandSample) -> float:
        """How far fingers may reach out of the view that are not seen to."""
        left, top, right, bottom = hand.box_px
        width, height = self._camera.width_px, self._camera.height_px
        touched = {"left": left, "top": top, "right": width - right, "bottom": height - bottom}
        at_edge = any(px <= PERSON.edge_px for edge, px in touched.items() if edge != self.edge)
        return PERSON.hand_length_m if at_edge else 0.0

    def _at_height(self, points_m: Array, height_m: float) -> Array:
        """Points (n, 2) as a tracker reports them, where they are at that height: on the same ray of the camera."""
        scale = (self._eye[2] - height_m) / (self._eye[2] - self._settings.assumed_height_m)
        moved: Array = self._eye[:2] + (points_m - self._eye[:2]) * scale
        return moved

    def _edge_line(self, edge: Edge, height_m: float) -> Array:
        """Two ends (2, 2) of an edge of the view, at a height, and outwards from there (2,)."""
        width, height = float(self._camera.width_px), float(self._camera.height_px)
        pixels = {
            "left": [(0.0, 0.0), (0.0, height)],
            "right": [(width, 0.0), (width, height)],
            "top": [(0.0, 0.0), (width, 0.0)],
            "bottom": [(0.0, height), (width, height)],
        }[edge]
        return self._camera.onto_plane(self._world_from_camera, np.array(pixels), height_m)[:, :2]

    def _outside(self, edge: Edge) -> coal.Convex:
        """All places beyond an edge of the view that a hand can be at, and how far it may be in before it is found."""
        layers = []
        for height_m in (0.0, self._settings.hand_height_m):
            first, last = self._edge_line(edge, height_m)
            along = (last - first) / np.linalg.norm(last - first)
            out = _outwards(first, last, self._eye[:2])
            first, last = (end - self._settings.intrusion_m * out for end in (first, last))
            first, last = first - PERSON.beyond_m * along, last + PERSON.beyond_m * along
            layers.append(np.array([first, last, last + PERSON.beyond_m * out, first + PERSON.beyond_m * out]))
        return _prism(layers[0], layers[1], self._settings.hand_height_m)

    def _towards_person(self, edge: Edge) -> float:
        """How far outwards from this edge is the way to the person, from -1 to 1."""
        first, last = self._edge_line(edge, 0.0)
        return float(_outwards(first, last, self._eye[:2])[0])


def _towards(vector: Array, ways: Array) -> tuple[float, Array]:
    """The length of a vector (2,), and what of it is along each of the ways (..., 3); all of it where there is none."""
    length, lengths = float(np.linalg.norm(vector)), np.linalg.norm(ways[..., :2], axis=-1)
    return length, np.where(lengths < TINY_M, length, ways[..., :2] @ vector / np.maximum(lengths, TINY_M))


def _outwards(first: Array, last: Array, inside: Array) -> Array:
    """The direction (2,) across a line, away from a point."""
    along = (last - first) / np.linalg.norm(last - first)
    across = np.array([-along[1], along[0]])
    away: Array = -across if (inside - first) @ across > 0 else across
    return away


def _top_m(hand: HandSample) -> float:
    """How high a hand reaches whose height is told."""
    return max(hand.height_m or 0.0, hand.fingertips_height_m or 0.0, 0.0) + PERSON.knuckles_m


def _prism(low_m: Array, high_m: Array, height_m: float | Array) -> coal.Convex:
    """Between four corners (4, 2) on the table and as many at a height, or a height each, both in order around it."""
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corners, heights_m in ((low_m, np.zeros(4)), (high_m, np.broadcast_to(height_m, 4))):
        for (x, y), z in zip(corners, heights_m, strict=True):
            points.append(np.array([x, y, z]))
    for a, b, c, d in FACES:
        faces.append(coal.Triangle(a, b, c))
        faces.append(coal.Triangle(a, c, d))
    return coal.Convex(points, faces)
