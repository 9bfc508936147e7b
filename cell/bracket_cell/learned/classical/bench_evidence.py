"""Whether each region of an overhead image shows this bench: landmarks from the first frame on, then a reference.

A reference of the empty bench grows where landmarks are seen and neither robot nor hand is. From then on each region
looks like the reference, or a robot or a hand that somebody knows of is in front of it. Nothing else explains a change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.calibration.landmarks import PlateModel, Rectangle
from bracket_cell.learned.classical.box_model import LEAST_DEPTH_M, View, obstacle_mask, outline
from bracket_cell.learned.classical.depth_evidence import COVERED, DepthEvidence
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Edge, HandSample
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product


@dataclass(frozen=True)
class SceneLimits:
    """When an image contradicts the bench. Origin: chosen on simulated assemblies, with and without obstacles and
    shadows, mirrored.

    Attributes:
        look_every_s: [s] between examinations.
        compare_every_s: [s] between comparisons.
        lasts_s: [s] for which something must be wrong.
        flickers: [looks] in a row that a group alone may be lost which came back once. Origin: a dark tray on a dark
            table came back within 15 in two brackets.
        stretch: [points] of an edge that are one landmark.
        reach_px: [px] by which landmarks may be off.
        step_px: [px] steps in which they are searched.
        edge_blur_px: [px] blur before slopes are taken.
        least_slope: [grey levels per px] of a landmark.
        least_along: cosine by which slopes point across a landmark.
        least_seen: share of a group of landmarks that is seen.
        least_beside: likewise of a group that is hidden in part.
        least_shown: share of a group that is judged.
        long: [landmarks] of a group that is never hidden.
        bin_m: [m] around a bin that is judged.
        least_contrast: [grey levels] between squares of 3 x 3 small pixels in a bin.
        frames_valid: [frames] without robot and hand until a pixel of the reference counts.
        alike: share by which the reference follows an image that is alike.
        changed: share by which it follows one that changed.
        levels: [grey levels] by which a pixel has changed.
        share: share of its brightness that is added to `levels`.
        lit: share of the reference above which a pixel is lit.
        darkest: share of the reference in the darkest shadow.
        most_shadow: share of pixels that a shadow takes.
        apart: share of the reference that a shadow apart from robot and hands leaves at least. Origin: .76 to .79 of
            an arm that is parked out of the image.
        even: by which that share may differ between colours; a thing of another colour differs more.
        thick: [small px] below which it is a part, a cable or an edge.
        thick_share: share of a square of that size that has changed.
        robot_px: [small px] around the robot's outline that may be of it.
        hand_px: [small px] around a hand's box that may be of it.
        aside: how much more a forearm points to a side than to the person's edge, from which on it comes from there.
        most_off: [grey levels] by which a pixel counts at most.
        turned: share of what is off, below which the image is turned over.
        most_robot: share of the image that the robot may take.
        most_changed: share of the image that may change at once.
        least_free: share of the image that must be free.
    """

    look_every_s: float = 0.3
    compare_every_s: float = 0.1
    lasts_s: float = 1.0
    flickers: int = 30
    stretch: int = 8
    reach_px: int = 6
    step_px: int = 2
    edge_blur_px: float = 1.5
    least_slope: float = 4.0
    least_along: float = 0.6
    least_seen: float = 0.6
    least_beside: float = 0.4
    least_shown: float = 0.6
    long: int = 4
    bin_m: float = 0.07
    least_contrast: float = 2.0
    frames_valid: int = 4
    alike: float = 1 / 64
    changed: float = 1 / 256
    levels: float = 5.0
    share: float = 0.16
    lit: float = 1.1
    darkest: float = 0.3
    most_shadow: float = 0.9
    apart: float = 0.6
    even: float = 0.1
    thick: int = 9
    thick_share: float = 0.6
    robot_px: int = 6
    hand_px: int = 4
    aside: float = 2.0
    most_off: float = 40.0
    turned: float = 0.6
    most_robot: float = 0.4
    most_changed: float = 0.5
    least_free: float = 0.2


SCENE = SceneLimits()


Mask = NDArray[np.uint8]

RISES = "something stands over the bench that is not seen as a hand"
NO_HAND = "something reaches into the view that is not seen as a hand"
TURNS = {"mirrored": (1,), "upside down": (0, 1), "mirrored and upside down": (0,)}  # by the axes that are turned over
TILE = 4  # pixels of the image in one of the small image, along both axes


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Stretches of edges of plate and tray.

    Attributes:
        places: (shifts, n, 2) pixels (column, row) of all points, as far off as they may be.
        across: (n, 2) unit vectors across the edge.
        stretch: (n,) which landmark a point is of.
        groups: (landmarks,) which pair of parallel edges a landmark is of.
    """

    places: NDArray[np.intp]
    across: Array
    stretch: NDArray[np.intp]
    groups: NDArray[np.intp]

    @staticmethod
    def of(bench: Bench, product: Product) -> Landmarks:
        """Those of a bench that are in view, and that none of its obstacles hides."""
        view, tray = View(bench.overhead.model, bench.overhead.mount.pose), bench.tray
        half, (x, y, z) = np.array(tray.size_m) / 2, tray.centre_m
        rim = Rectangle.between(-half, half, Pose((x, y, z + tray.wall_m)))
        steps = range(-SCENE.reach_px, SCENE.reach_px + 1, SCENE.step_px)
        shifts = np.array([(column, row) for column in steps for row in steps])
        size = bench.overhead.model.width_px, bench.overhead.model.height_px
        covered = obstacle_mask(view, bench, SCENE.reach_px)
        found: list[tuple[Array, Array, int]] = []
        for number, rectangle in enumerate((PlateModel.of(bench, product), rim)):
            start = view.pixels(rectangle.edges_m)
            unit = view.pixels(rectangle.edges_m + 0.01 * rectangle.outwards) - start
            unit /= np.linalg.norm(unit, axis=1, keepdims=True)
            for side in range(4):
                own = np.flatnonzero(rectangle.sides == side)
                parts = np.array_split(own, max(1, round(len(own) / SCENE.stretch)))
                low, high = SCENE.reach_px, np.array(size) - SCENE.reach_px - 1
                inside = [part for part in parts if ((start[part] > low) & (start[part] < high)).all()]
                places = ((part, *start[part].astype(int).T) for part in inside)
                shown = [part for part, column, row in places if not covered[row, column].any()]
                found += [(start[part], unit[part], 2 * number + side // 2) for part in shown]
        if not found:
            return Landmarks(np.zeros((1, 0, 2), np.intp), np.zeros((0, 2)), *np.zeros((2, 0), np.intp))
        points, across, groups = zip(*found, strict=True)
        places = np.rint(np.concatenate(points) + shifts[:, np.newaxis]).astype(np.intp)
        stretch = np.repeat(np.arange(len(found)), [len(point) for point in points])
        return Landmarks(places, np.concatenate(across), stretch, np.array(groups))

    def seen(self, grey: NDArray[np.uint8], hidden: NDArray[np.bool_]) -> dict[int, bool]:
        """Of each group that is not mostly hidden, whether its landmarks are seen, at the shift that most are seen at.

        Args:
            hidden: pixels of the small image that robot or hands may be in front of.
        """
        if not len(self.groups):
            return {}
        smooth = cv2.GaussianBlur(grey, (0, 0), SCENE.edge_blur_px)
        columns, rows = self.places[..., 0], self.places[..., 1]
        x, y = (cv2.Sobel(smooth, cv2.CV_32F, *way)[rows, columns] for way in ((1, 0), (0, 1)))
        along = (x * self.across[:, 0] + y * self.across[:, 1]) / np.maximum(np.hypot(x, y), SCENE.least_slope)
        clear = np.abs(np.add.reduceat(along, self._starts, axis=1)) / np.bincount(self.stretch) > SCENE.least_along
        open_ = self.open_to(hidden)
        best = clear[clear[:, open_].sum(axis=1).argmax()]
        found = {}
        for group in np.unique(self.groups):
            shown = open_[self.groups == group]
            if shown.mean() >= SCENE.least_shown:
                share = best[open_ & (self.groups == group)].mean()
                found[int(group)] = bool(share >= (SCENE.least_seen if shown.all() else SCENE.least_beside))
        return found

    @cached_property
    def _starts(self) -> NDArray[np.intp]:
        """(landmarks,) number of the first point of each."""
        return np.flatnonzero(np.diff(self.stretch, prepend=-1))

    def open_to(self, hidden: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(landmarks,) which have nothing in front of them, by a small image."""
        column, row = self.places[len(self.places) // 2, self._starts].T // TILE
        open_: NDArray[np.bool_] = ~hidden[row, column]
        return open_


def leaves_in_view(bench: Bench, product: Product) -> Callable[[Array], bool]:
    """Whether a robot, by its points as `Frame.robot_m` has them, leaves so much to be seen that a run may begin.

    What was never seen is not known to be there, and the robot stands until it is.
    """
    landmarks, model = Landmarks.of(bench, product), bench.overhead.model
    view = View(model, bench.overhead.mount.pose)
    shape = model.height_px // TILE, model.width_px // TILE

    def leaves(robot_m: Array) -> bool:
        open_ = landmarks.open_to(near_robot(robot_outline(robot_m, view, shape)))
        groups = np.unique(landmarks.groups)
        return all(open_[landmarks.groups == group].mean() >= SCENE.least_shown for group in groups)

    return leaves


class SceneConsistency:
    """Looks at the frames of the overhead camera in their order.

    Attributes:
        unseen: why an image does not show this bench, in words; empty where it does.
        unexplained: what reaches over the person's edge that is neither the robot nor a hand that was seen.
    """

    def __init__(self, bench: Bench, product: Product) -> None:
        model = bench.overhead.model
        self._view = View(model, bench.overhead.mount.pose)
        self._landmarks = Landmarks.of(bench, product)
        self._bins = [_around(self._view, place) for place in bench.bins_m.values()]
        shape = model.height_px // TILE, model.width_px // TILE
        self._reference = np.zeros((*shape, 3), np.float32)
        self._frames = np.zeros(shape, np.float32)  # that it was made of
        self._edge = person_edge(bench)
        self._rim, self._persons = _rims(shape, self._edge)
        self._tray = _tray(self._view, bench, shape)
        self._depth = DepthEvidence(bench) if bench.overhead.depth else None
        self._looked_s = self._compared_s = -np.inf
        self._astray = 0  # groups of landmarks that are not where they were
        self._wrong, self._wrong_s = "", 0.0  # what is wrong, and for how long more than not
        groups, counts = np.unique(self._landmarks.groups, return_counts=True)
        self._always = groups[counts >= SCENE.long].tolist()
        self._missing = set(groups.tolist())  # that were never seen
        self._lost, self._faint = set[int](), set[int]()  # not where they were; came back, so that light may hide them
        self._alone = 0  # looks in a row in which the same group alone was lost
        self.unseen = self.unexplained = ""

    def see(self, frame: Frame, small: Mask, grey: Mask, hands: Sequence[HandSample]) -> None:
        """One frame more.

        Args:
            small: every pixel the mean of TILE x TILE of the image, in colour.
            grey: the image in grey.
        """
        now_s, since_s = frame.time_s, frame.time_s - self._compared_s
        if since_s < SCENE.compare_every_s:
            return
        self._compared_s, shape = now_s, self._frames.shape
        hidden = near_robot(robot_outline(frame.robot_m, self._view, shape)) | self._arms(hands, shape)
        if now_s >= self._looked_s + SCENE.look_every_s:
            self._looked_s, self._astray = now_s, self._look(small, grey, hidden)
        wrong = "the bench is not seen" if self._astray or self._missing else self._compare(small, hidden)
        turned = self._turned(small)
        wrong = turned or wrong or self._by_depth(frame, hidden)
        doubtful = self._astray == 1 and not self._missing  # shadows and parts hide edges, too
        step_s = SCENE.lasts_s / 2 if turned else min(since_s, 2 * SCENE.compare_every_s) / (3 if doubtful else 1)
        self._wrong_s = (
            min(self._wrong_s + step_s, 2 * SCENE.lasts_s) if wrong else max(0.0, self._wrong_s - step_s / 2)
        )
        self._wrong = wrong or self._wrong
        reason = self._wrong if self._wrong_s >= SCENE.lasts_s else ""
        self.unexplained, self.unseen = (reason, "") if reason in (NO_HAND, RISES) else ("", reason)

    def _arms(self, hands: Sequence[HandSample], shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Hands in a small image with their arms, from the person's edge or the one that a forearm points at."""
        mask = np.zeros(shape, bool)
        for hand in hands:
            ends_m = [(*at, hand.height_m or 0.0) for at in (hand.fingertips_m, hand.palm_m)]
            tips_px, palm_px = self._view.pixels(np.array(ends_m))
            column, row = palm_px - tips_px
            aside, own = (abs(float(column)), abs(float(row)))[:: 1 if self._edge in ("top", "bottom") else -1]
            mask |= _towards(_edge_at(column, row) if aside > SCENE.aside * own else self._edge, hand, shape)
        return mask

    def _by_depth(self, frame: Frame, hidden: NDArray[np.bool_]) -> str:
        """What stands over the bench that colours do not show, in words; a robot that nobody tells of would count."""
        if self._depth is None:
            return ""
        risen = None if frame.depth_mm is None else self._depth.risen(frame.depth_mm, hidden)
        return COVERED if risen is None else RISES if risen.any() and frame.robot_m is not None else ""

    def _look(self, small: Mask, grey: Mask, hidden: NDArray[np.bool_]) -> int:
        """How many groups of landmarks are not where the calibration has them; at first, bins without contrast, too."""
        seen = self._landmarks.seen(grey, hidden)
        first, self._missing = bool(self._missing), self._missing - {group for group, clear in seen.items() if clear}
        lost = {group for group in self._always if not seen.get(group, True)}
        if len(self._lost) == 1:
            self._faint |= {group for group in self._lost if seen.get(group, False)}
        self._alone = self._alone + 1 if len(lost) == 1 and lost == self._lost else 0
        self._lost = lost
        if first and not self._missing:
            coarse = cv2.resize(small, None, fx=1 / 3, fy=1 / 3, interpolation=cv2.INTER_AREA)
            bins = [coarse[window] for window in self._bins if coarse[window].size]
            if any(float(bin_.std(axis=(0, 1)).max()) <= SCENE.least_contrast for bin_ in bins):
                self._missing = set(seen)
        flickers = len(lost) == 1 and lost <= self._faint and self._alone < SCENE.flickers
        return 0 if flickers else len(lost)

    def _compare(self, small: Mask, hidden: NDArray[np.bool_]) -> str:
        """What of an image differs from the reference, in words: most of it, or a piece that nothing explains."""
        image = small.astype(np.float32)
        free = (self._frames >= SCENE.frames_valid) & ~hidden
        image *= 1 / self._gain(image, free)
        off, bright = _greatest(cv2.absdiff(image, self._reference)), _greatest(self._reference)
        changed = free & (off > SCENE.levels + SCENE.share * bright)
        wrong = self._unexplained(changed, hidden, image)
        rate = np.where(changed, np.float32(SCENE.changed), np.float32(SCENE.alike))
        rate = np.maximum(rate, (self._frames < SCENE.frames_valid) / (self._frames + 1)) * ~hidden
        self._frames += ~hidden
        self._reference += cv2.merge([rate] * 3) * (image - self._reference)
        if changed.sum() > SCENE.most_changed * free.sum() and free.mean() > SCENE.least_free:
            return "the bench is not seen"
        return wrong

    def _turned(self, small: Mask) -> str:
        """Whether the reference is seen turned over, in words; empty where it is seen as it is, or is not known."""
        known = self._frames >= SCENE.frames_valid
        if known.mean() < SCENE.least_free:
            return ""
        reference = self._reference * (float(small.mean()) / max(1.0, float(self._reference[known].mean())))
        image = small.astype(np.float32)

        def off(axes: tuple[int, ...]) -> float:
            seen = known & np.flip(known, axes)
            return float(np.minimum(np.abs(np.flip(image, axes) - reference), SCENE.most_off)[seen].mean())

        straight = off(())
        turns = {words: off(axes) for words, axes in TURNS.items()}
        words = min(turns, key=lambda turn: turns[turn])
        return f"the image is {words}" if turns[words] < SCENE.turned * straight else ""

    def _gain(self, image: NDArray[np.float32], free: NDArray[np.bool_]) -> float:
        """How much brighter an image is than the reference."""
        grid = free[::3, ::3]
        ratios = (image[::3, ::3, 1][grid] + 1) / (self._reference[::3, ::3, 1][grid] + 1)
        return float(np.median(ratios)) if ratios.size else 1.0

    def _unexplained(self, changed: NDArray[np.bool_], hidden: NDArray[np.bool_], image: NDArray[np.float32]) -> str:
        """What a large piece is that has changed, in words; empty where there is none, or robot and person explain it.

        What hangs together with the robot, a hand or an edge may be their shadow, or a robot that nobody tells of. On
        the person's side it may be a hand, but for what is only darker. Apart from them only what is a little darker in
        all colours alike is a shadow. Within the tray parts come and go.
        """
        mask, found = changed.astype(np.uint8), ""
        shares = cv2.boxFilter(mask, cv2.CV_32F, (SCENE.thick, SCENE.thick), borderType=cv2.BORDER_REPLICATE)
        thick = changed & (shares > SCENE.thick_share)
        if not thick.any():
            return ""
        _, labels = cv2.connectedComponents(cv2.dilate(mask, np.ones((3, 3), np.uint8)))
        around = self._rim | (cv2.dilate(hidden.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
        for label in np.unique(labels[thick]):
            own = labels == label
            if not (own & ~self._tray).any():
                continue  # parts that stood side by side, and were taken
            across = (own[:, 0].any() and own[:, -1].any()) or (own[0].any() and own[-1].any())
            shares = (image[own & changed] + 1) / (self._reference[own & changed] + 1)
            explained = (own & around).any() or _shadow_apart(shares)
            if across or own.mean() > SCENE.most_robot or not explained:
                return "something covers the view"
            if (own & self._persons).any() and not _shadow(shares, SCENE.darkest):
                found = NO_HAND
        return found


def _shadow(shares: NDArray[np.float32], darkest: float) -> bool:
    """Whether pixels (n, 3), as shares of the reference, are nothing but darker."""
    dark = (shares < SCENE.lit).all(axis=1) & (shares > darkest).all(axis=1)
    return bool(dark.mean() > SCENE.most_shadow)


def _shadow_apart(shares: NDArray[np.float32]) -> bool:
    """Whether they are a little darker, in all colours alike."""
    return _shadow(shares, SCENE.apart) and bool(np.ptp(np.median(shares, axis=0)) < SCENE.even)


def person_edge(bench: Bench) -> Edge:
    """The edge of the overhead view behind which the person stands: x points towards the person."""
    middle = np.array(bench.bracket.position_m)
    start, end = View(bench.overhead.model, bench.overhead.mount.pose).pixels(
        np.array([middle, middle + np.array([0.1, 0.0, 0.0])])
    )
    return _edge_at(*(end - start))


def _edge_at(column: float, row: float) -> Edge:
    """The edge of an image that a direction in it points at."""
    if abs(column) > abs(row):
        return "right" if column > 0 else "left"
    return "bottom" if row > 0 else "top"


def _around(view: View, place: Sequence[float]) -> tuple[slice, slice]:
    """Rows and columns of the coarse image around a place of the bench."""
    column, row = view.pixels(np.array([place], float))[0] / (3 * TILE)
    reach = view.pixels_per_m(place) * SCENE.bin_m / (3 * TILE)
    rows, columns = (slice(max(0, round(at - reach)), max(0, round(at + reach) + 1)) for at in (row, column))
    return rows, columns


def _tray(view: View, bench: Bench, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels of a small image that show the inside of the tray."""
    mask, half, (x, y, z) = np.zeros(shape, np.uint8), np.array(bench.tray.size_m) / 2, bench.tray.centre_m
    corners = np.array([[x + a * half[0], y + b * half[1], z] for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))])
    cv2.fillConvexPoly(mask, np.rint(view.pixels(corners) / TILE).astype(np.int32), 1)
    return cv2.erode(mask, np.ones((3, 3), np.uint8)) > 0


def _rims(shape: tuple[int, int], edge: Edge) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """All pixels at the edges of an image, and those at one edge."""
    rim, own = np.ones(shape, bool), np.zeros(shape, bool)
    rim[1:-1, 1:-1] = False
    if edge in ("left", "right"):
        own[:, 0 if edge == "left" else -1] = True
    else:
        own[0 if edge == "top" else -1] = True
    return rim, own


def robot_outline(robot_m: Array | None, view: View, shape: tuple[int, ...]) -> Mask:
    """1 inside the robot's outline in a small image, (height, width).

    Args:
        robot_m: as `Frame.robot_m`.
    """
    mask = np.zeros(shape, np.uint8)
    if robot_m is not None:
        points_m = robot_m.reshape(-1, 3)
        links = len(robot_m)
        behind = np.reshape(view.depths(points_m) < LEAST_DEPTH_M, (links, -1)).any(axis=1)
        pixels = (view.pixels(points_m) / TILE).reshape(links, -1, 2)
        for link in pixels[~behind]:
            cv2.fillConvexPoly(mask, outline(link).round().astype(np.int32), 1)
    return mask


def near_robot(robot: Mask) -> NDArray[np.bool_]:
    """Where the robot may be."""
    return cv2.dilate(robot, np.ones((2 * SCENE.robot_px + 1,) * 2, np.uint8)) > 0


def _towards(edge: Edge, hand: HandSample, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """A hand in a small image, and all between it and an edge: arms come from there, askew by up to 45 degrees."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    left, top, right, bottom = (value / TILE for value in hand.box_px)
    ahead, aside, start, low, high = {
        "bottom": (rows, columns, top, left, right),
        "top": (-rows, columns, -bottom, left, right),
        "right": (columns, rows, left, top, bottom),
        "left": (-columns, rows, -right, top, bottom),
    }[edge]
    beyond = ahead - start + SCENE.hand_px
    mask: NDArray[np.bool_] = beyond >= 0
    return mask & (aside >= low - SCENE.hand_px - beyond) & (aside <= high + SCENE.hand_px + beyond)


def _greatest(image: NDArray[Any]) -> NDArray[np.float32]:
    """Of the three channels of each pixel."""
    red, green, blue = cv2.split(image)
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.float32)
