"""A camera that cannot be believed says so; a hand that vanished is not a hand that left."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import cycle
from types import SimpleNamespace
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.learned.classical.bench_evidence import TILE, Landmarks, SceneConsistency
from bracket_cell.learned.classical.box_model import View, obstacle_mask
from bracket_cell.learned.classical.image_health import Freshness, ImageHealth
from bracket_cell.learned.classical.track_health import TrackHealth, motion_of
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Obstacle
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from tests.integration.cell_rig import BENCH, PRODUCT, with_person
from tests.learned.classical.scenes import classical_bench_watcher

Image = NDArray[np.uint8]
Seen = tuple[Frame, list[HandSample]]
SOUND, SPOILED = 20, 40


@pytest.fixture(scope="module")
def frames() -> Iterator[list[Frame]]:
    """Three seconds of a person at work."""
    seen: list[Frame] = []
    with with_person("g0", 5) as cell:
        clock, camera = cell.devices.clock, cell.devices.overhead
        while len(seen) < SOUND + SPOILED:
            clock.sleep_until(clock.now_s() + 0.04)
            frame = camera.latest()
            if frame is not None and (not seen or frame.sequence > seen[-1].sequence):
                image = np.array(frame.image)
                seen.append(Frame(frame.camera, frame.sequence, frame.time_s, image, frame.world_from_camera))
        yield seen


@pytest.fixture(scope="module")
def seen(frames: list[Frame]) -> list[Seen]:
    """The same, with the hands that are seen."""
    watcher = classical_bench_watcher(BENCH, PRODUCT)
    return [(frame, list(watcher.watch(frame).hands)) for frame in frames]


def scaled(factor: float, *channels: float) -> Callable[[Image], Image]:
    return lambda image: np.clip(image * factor * np.array(channels or (1.0,)), 0, 255).astype(np.uint8)


SPOILS: dict[str, tuple[Callable[[Image], Image], str]] = {
    "black": (scaled(0.0), "dark"),
    "white": (lambda image: np.full_like(image, 255), "bright"),
    "grey": (lambda image: np.full_like(image, 128), "without contrast"),
    "gain 1.5": (scaled(1.5), "brighter"),
    "half the light": (scaled(0.5), "darker"),
    "red and blue swapped": (lambda image: np.ascontiguousarray(image[..., ::-1]), "discoloured"),
    "cold light": (scaled(1.0, 0.8, 1.0, 1.25), "discoloured"),
    "out of focus": (lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), 3), np.uint8), "blurred"),
}


class Shot(NamedTuple):
    """A sound image, its number, and all frames."""

    number: int
    image: Image
    frames: Sequence[Frame]


def half_frozen(one: Shot) -> Image:
    return np.hstack([one.frames[0].image[:, :240], one.image[:, 240:]])


def torn(one: Shot) -> Image:
    return np.vstack([one.image[:120], np.roll(one.image[120:], 40, axis=1)])


def blocks(one: Shot) -> Image:
    spoiled, rng = one.image.copy(), np.random.default_rng(one.number)
    for row, column in zip(rng.integers(0, 360, 40), rng.integers(0, 480, 40), strict=True):
        spoiled[row : row + 32, column : column + 32] = rng.integers(0, 255, 3)
    return spoiled


def blobs(one: Shot) -> Image:
    spoiled = one.image.copy()
    for middle in ((120, 200), (300, 250), (400, 120)):
        cv2.circle(spoiled, middle, 45, (120, 118, 115), -1)
    return spoiled


def glare(one: Shot) -> Image:
    row, column = np.ogrid[:360, :480]
    light = 200 * np.exp(-((row - 180) ** 2 + (column - 240) ** 2) / 6000)
    return np.asarray(np.clip(one.image + light[..., np.newaxis], 0, 255), np.uint8)


def bars(one: Shot) -> Image:
    phase = (np.arange(360) / 60 + 0.37 * one.number) * 2 * np.pi
    return np.asarray(np.clip(one.image * (0.75 + 0.25 * np.sin(phase))[:, np.newaxis, np.newaxis], 0, 255), np.uint8)


def anything(one: Shot) -> Image:
    return np.random.default_rng(one.number).integers(60, 180, one.image.shape, dtype=np.uint8)


def noisy(number: int, image: NDArray[Any]) -> Image:
    return np.clip(image + np.random.default_rng(number).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


Odd = Callable[[Shot], Image]
ODD: dict[str, Odd] = {
    "noise": anything,
    "half of it noise": lambda shot: np.hstack([shot.image[:, :240], anything(shot)[:, 240:]]),
    "upside down": lambda shot: np.ascontiguousarray(shot.image[::-1, ::-1]),
    "mirrored": lambda shot: np.ascontiguousarray(shot.image[:, ::-1]),
    "turned by 5 degrees": lambda shot: np.asarray(
        cv2.warpAffine(shot.image, cv2.getRotationMatrix2D((240, 180), 5, 1), (480, 360)), np.uint8
    ),
    "another place": lambda shot: noisy(
        shot.number, np.full_like(shot.image, 90) + np.uint8(9) * (shot.image[::-1] % 9)
    ),
    "lower half grey": lambda shot: np.vstack([shot.image[:180], np.full_like(shot.image[180:], 128)]),
    "lower half grey, with noise": lambda shot: noisy(
        shot.number, np.vstack([shot.image[:180], 0 * shot.image[180:] + 128])
    ),
    "a third covered": lambda shot: noisy(shot.number, np.hstack([0 * shot.image[:, :160], shot.image[:, 160:]])),
    "left half frozen": half_frozen,
    "a loop of 6 frames": lambda shot: shot.frames[shot.number % 6].image,
    "torn": torn,
    "broken blocks": blocks,
    "blobs on the lens": blobs,
    "glare": glare,
    "rolling bars": bars,
    "grey": lambda shot: np.repeat(shot.image.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8),
    "a flickering lamp": lambda shot: scaled(0.6 + 0.4 * float(np.sin(shot.number)))(shot.image),
}
LATER: dict[str, Odd] = {  # what shows only by a comparison with before
    "pushed aside": lambda shot: np.roll(shot.image, 12, axis=1),
    "pushed far": lambda shot: np.roll(shot.image, 40, axis=0),
    "zoomed": lambda shot: np.asarray(cv2.resize(shot.image[30:-30, 40:-40], (480, 360)), np.uint8),
    "frames of 1 s ago": lambda shot: shot.frames[shot.number - 15].image,
    "a blob with noise": lambda shot: noisy(
        shot.number, cv2.circle(shot.image.copy(), (330, 60), 45, (50, 45, 40), -1)
    ),
}
HEALTHY_S, COMPARED_S = 2.0, 3.0  # for so long an odd image may be taken for a sound one


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(SPOILS))
def test_a_spoiled_image_is_found_and_named(frames: list[Frame], name: str) -> None:
    spoil, words = SPOILS[name]
    health = ImageHealth(BENCH, PRODUCT)
    assert [health.judge(frame) for frame in frames[:SOUND]] == [""] * SOUND
    told = [health.judge(replace(frame, image=spoil(frame.image))) for frame in frames[SOUND:]]
    assert all(one.startswith(words) for one in told[:1])
    assert all(told)


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(ODD))
def test_an_odd_image_is_told_from_the_start(seen: list[Seen], name: str) -> None:
    assert longest_healthy_s(seen, ODD[name], 0) <= HEALTHY_S


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(ODD))
def test_an_odd_image_is_told_after_sound_ones(seen: list[Seen], name: str) -> None:
    assert longest_healthy_s(seen, ODD[name], SOUND) <= HEALTHY_S


@pytest.mark.parametrize("name", sorted(LATER))
def test_what_is_odd_by_comparison_is_told_after_sound_ones(seen: list[Seen], name: str) -> None:
    assert longest_healthy_s(seen, LATER[name], SOUND) <= COMPARED_S


def test_sound_images_of_a_person_at_work_are_sound(seen: list[Seen]) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    assert {health.judge(frame, hands) for frame, hands in seen} == {""}


def test_parts_that_are_taken_out_of_the_tray_are_nothing_that_covers_the_view(seen: list[Seen]) -> None:
    health = ImageHealth(BENCH, PRODUCT)

    def judged(number: int, frame: Frame, hands: list[HandSample]) -> str:
        image = frame.image.copy()
        if number < SOUND:  # four that stand side by side
            image[60:110, 70:130] = noisy(number, np.full((50, 60, 3), (160, 30, 30), np.uint8))
        return health.judge(replace(frame, image=image), hands)

    assert {judged(number, *one) for number, one in enumerate(seen)} == {""}


@pytest.mark.parametrize(("share", "sound"), [(0.75, True), (0.5, False), (0.15, False), ((0.9, 0.7, 0.7), False)])
def test_a_shadow_that_lies_apart_is_nothing_that_covers_the_view(
    seen: list[Seen], share: float | tuple[float, ...], sound: bool
) -> None:
    """Of an arm above the tray, which the image does not show; what is darker, or of another colour, is a thing."""
    health = ImageHealth(BENCH, PRODUCT)

    def judged(number: int, frame: Frame, hands: list[HandSample]) -> str:
        image = frame.image.copy()
        if number >= SOUND:
            image[50:130, 40:200] = noisy(number, np.array(share) * image[50:130, 40:200])
        return health.judge(replace(frame, image=image), hands)

    assert ({judged(number, *one) for number, one in enumerate(seen)} == {""}) == sound


@pytest.mark.parametrize("white", [True, False])
def test_an_arm_in_bright_light_hides_no_more_than_another(seen: list[Seen], white: bool) -> None:
    health, view = ImageHealth(BENCH, PRODUCT), View(BENCH.overhead.model, BENCH.overhead.mount.pose)
    corners = np.array([[400.0, 10.0], [460.0, 10.0], [460.0, 70.0], [400.0, 70.0]])
    link = np.column_stack([view.on_plane(corners, 0.2), np.full(4, 0.2)])

    def judged(number: int, frame: Frame, hands: list[HandSample], link: NDArray[Any] | None) -> str:
        image = frame.image.copy()
        image[10:70, 400:460] = noisy(number, np.full((60, 60, 3), 250 if white else 2, np.uint8))
        return health.judge(replace(frame, image=image, robot_m=None if link is None else link[np.newaxis]), hands)

    assert {judged(number, *one, link) for number, one in enumerate(seen[:SOUND])} == {""}
    assert "glaring" in judged(SOUND, *seen[SOUND], None)


def test_a_hand_that_nobody_sees_as_one_is_unexplained(seen: list[Seen]) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    told = [health.judge(frame, hands if number < SOUND else []) for number, (frame, hands) in enumerate(seen)]
    assert not any(told[:SOUND])
    assert any(told[SOUND:])


def longest_healthy_s(seen: list[Seen], odd: Odd, first: int) -> float:
    """How long at a stretch images are called sound that are odd from a frame on."""
    health, frames = ImageHealth(BENCH, PRODUCT), [frame for frame, _ in seen]
    longest = healthy = 0
    for number, (frame, hands) in enumerate(seen):
        image = odd(Shot(number, frame.image, frames)) if number >= first else frame.image
        told = health.judge(replace(frame, image=np.ascontiguousarray(image)), hands)
        healthy = 0 if told or number < first else healthy + 1
        longest = max(longest, healthy)
    return longest / BENCH.overhead.rate_hz


def test_a_frozen_image_with_new_numbers_and_stamps_is_found(frames: list[Frame]) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    told = [health.judge(replace(frame, image=frames[0].image)) for frame in frames[:6]]
    assert told == ["", *["frozen"] * 5]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda image: image[..., 0], "1 channel, must have 3"),
        (lambda image: np.dstack([image, image[..., :1]]), "4 channels, must have 3"),
        (lambda image: image / 255.0, "float64, must be uint8"),
        (lambda image: image.astype(np.uint16) * 256, "uint16, must be uint8"),
        (lambda image: image[::2, ::2], "240 x 180, must be 480 x 360"),
    ],
)
def test_an_image_of_another_kind_is_a_fault_in_plain_words(
    frames: list[Frame], spoil: Callable[[Image], Image], words: str
) -> None:
    watcher = classical_bench_watcher(BENCH, PRODUCT)
    with pytest.raises(DeviceFault, match=words):
        watcher.watch(replace(frames[0], image=spoil(frames[0].image)))


def test_an_image_that_is_black_from_the_start_is_found() -> None:
    health = ImageHealth(BENCH, PRODUCT)
    black = np.zeros((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), np.uint8)
    assert health.judge(Frame("overhead", 0, 0.0, black, BENCH.overhead.mount.pose)) == "dark"


@pytest.mark.parametrize("blur_px", [3.5, 5])
def test_a_lens_that_is_out_of_focus_from_the_start_is_found(frames: list[Frame], blur_px: float) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    blurred = [replace(frame, image=np.asarray(cv2.GaussianBlur(frame.image, (0, 0), blur_px))) for frame in frames]
    told = [health.judge(frame) for frame in blurred]
    assert told[:5] == [""] * 5  # an arm over the edges looks like that for a moment
    assert told.count("blurred") > 0.8 * len(told)
    assert set(told) <= {"", "blurred", "frozen in part"}  # the blur has smoothed the noise, too


def test_the_watcher_hands_health_and_speed_on(frames: list[Frame]) -> None:
    watcher = classical_bench_watcher(BENCH, PRODUCT)
    views = [watcher.watch(frame) for frame in frames]
    assert {view.health for view in views} == {""}
    assert {view.hand_unknown for view in views} == {""}
    speeds = [view.hand.speed_m_s for view in views if view.hand is not None and view.hand.velocity_m_s is not None]
    assert len(speeds) > 30
    assert 0.2 < max(speed for speed in speeds if speed is not None) < 2.0


def test_velocity_is_a_mean_and_acceleration_follows_from_the_last_three_places() -> None:
    """Of 4 m/s2 from 0.5 m/s, also where frames are lost; with one stamp twice nothing is known."""
    times_s = (0.0, 0.1, 0.3, 0.4)
    goes_m = [(0.5 * time_s + 2.0 * time_s**2, 0.1) for time_s in times_s]
    places = [
        (time_s, np.array([palm_m, np.add(palm_m, (-0.12, 0.0))]))
        for time_s, palm_m in zip(times_s, goes_m, strict=True)
    ]
    velocity, acceleration = motion_of(places)
    assert velocity == pytest.approx((0.5 + 2.0 * 0.4, 0.0))
    assert acceleration == pytest.approx((4.0, 0.0))
    assert motion_of(places[:1]) == (None, None)
    assert motion_of(places[:2])[1] is None
    assert motion_of([*places, places[-1]]) == (None, None)


@pytest.mark.parametrize("fixed", [0, 1])
def test_a_hand_that_turns_about_a_point_of_its_own_gains_no_speed(fixed: int) -> None:
    """As with a screwdriver: fingertips or palm stay where they are; of both together all counts."""
    turning = [
        (0.1 * n, np.array([0.8, 0.3]) + (np.arange(2) != fixed)[:, None] * [0.03 * n**2, 0.0]) for n in range(3)
    ]
    assert motion_of(turning)[1] == (0.0, 0.0)
    going = [(time_s, np.array([at[1 - fixed]] * 2)) for time_s, at in turning]
    assert motion_of(going)[1] == pytest.approx((6.0, 0.0))


def hand(x_m: float, box_px: tuple[int, int, int, int]) -> HandSample:
    return HandSample(0.0, box_px, (x_m - 0.12, 0.1), (x_m, 0.1))


def track(*boxes: tuple[int, int, int, int] | None) -> list[str]:
    """What is said of a hand seen in these boxes, 15 a second."""
    health = TrackHealth(BENCH)
    return [
        health.unknown(number / 15, None if box is None else hand(0.7 + 0.01 * number, box))
        for number, box in enumerate(boxes)
    ]


def test_a_hand_that_vanishes_in_mid_view_is_unknown_until_it_is_seen_again() -> None:
    middle = (200, 100, 260, 200)
    told = track(None, middle, middle, None, None, None, middle, None)
    assert told == ["", "", "", *["it vanished inside the view"] * 3, "", "it vanished inside the view"]


def test_a_hand_that_leaves_by_the_edge_is_gone() -> None:
    assert track((200, 250, 260, 320), (200, 290, 260, 357), None, None) == [""] * 4


def test_a_fast_hand_that_passes_the_edge_between_two_frames_is_gone() -> None:
    assert track((200, 180, 260, 240), (200, 230, 260, 290), (200, 280, 260, 340), None) == [""] * 4


def test_a_hand_that_was_all_in_view_cannot_leave_between_two_frames() -> None:
    """Its wrist touches the edge always; when all of it vanishes at once, something covers it."""
    reaching = (200, 100, 260, 358)
    assert track(reaching, reaching, None, None) == ["", "", *["it vanished inside the view"] * 2]


def test_before_the_first_hand_there_may_be_one_beyond_the_person_s_edge() -> None:
    health = TrackHealth(BENCH)
    assert health.unknown(0.0, None) == ""
    assert health.left_by == ("bottom",)


def test_it_is_told_by_which_edge_a_hand_left() -> None:
    health = TrackHealth(BENCH)
    for number, box in enumerate([(60, 100, 120, 160), (30, 100, 90, 160), (2, 100, 60, 160)]):
        health.unknown(number / 15, hand(0.7, box))
        assert health.left_by == ()
    for number in (3, 4, 60):
        assert health.unknown(number / 15, None) == ""
        assert health.left_by == ("left",)
    health.unknown(61 / 15, hand(0.7, (2, 100, 60, 160)))
    assert health.left_by == ()


def test_landmarks_that_an_obstacle_hides_are_not_asked_for_and_others_are() -> None:
    x, y, _ = BENCH.bracket.position_m
    post = Obstacle(name="post", position_m=(x, y - 0.08, 0.18), box_m=(0.10, 0.04, 0.36))
    with_it = BENCH.model_copy(update={"obstacles": (post,)})
    covered = obstacle_mask(View(BENCH.overhead.model, BENCH.overhead.mount.pose), with_it)
    every, kept = (Landmarks.of(bench, PRODUCT) for bench in (BENCH, with_it))
    hidden = [covered[places[:, 1], places[:, 0]].any() for places in (every.places[0], kept.places[0])]
    assert hidden == [True, False]
    assert 0.5 * len(every.groups) < len(kept.groups) < len(every.groups)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda one: noisy(one.number, one.frames[29].image), "frozen, but for its noise"),
        (
            lambda one: np.hstack([one.image[:, :240], noisy(one.number, one.frames[29].image[:, 240:])]),
            "frozen, but for its noise",
        ),
        (
            lambda one: np.vstack([one.image[:240], noisy(one.number, one.frames[29].image[240:])]),
            "frozen, but for its noise",
        ),
        (lambda one: noisy(one.number, one.frames[one.number % 10 + 20].image), "an image of 10 frames ago came again"),
        (lambda one: np.ascontiguousarray(one.image[:, ::-1]), "the image is mirrored"),
        (lambda one: np.ascontiguousarray(one.image[::-1, ::-1]), "the image is upside down"),
    ],
)
def test_copies_under_fresh_noise_and_turned_images_are_told_within_five_frames(
    seen: list[Seen], spoil: Odd, words: str
) -> None:
    health, frames = ImageHealth(BENCH, PRODUCT), [frame for frame, _ in seen]
    told = [
        health.judge(
            replace(frame, image=spoil(Shot(number, frame.image, frames)) if number >= 30 else frame.image), hands
        )
        for number, (frame, hands) in enumerate(seen[:35])
    ]
    assert not any(told[:30])
    assert words in told[30:]


def test_a_camera_that_sends_each_image_twice_is_named_for_it(seen: list[Seen]) -> None:
    health = ImageHealth(BENCH, PRODUCT)
    told = [health.judge(replace(frame, image=seen[number // 2][0].image)) for number, (frame, _) in enumerate(seen)]
    assert set(told[20:]) == {"sent several times: 7.5 new ones a second, not 15 as rate_hz says"}


def test_one_image_that_looks_like_an_old_one_is_chance_and_two_are_old_images() -> None:
    still = np.full((90, 120, 3), 120, np.uint8)
    frames = [noisy(number, still) for number in range(40)]
    once, again = Freshness(15.0), Freshness(15.0)
    for number in [*range(30), 3, *range(30, 40)]:
        once.judge(frames[number])
        assert once.repeats == ""
    for number in [*range(30), 13, 14]:
        again.judge(frames[number])
    assert again.repeats == "an image of 17 frames ago came again"


@pytest.mark.parametrize(
    ("faint", "steady", "unseen"),
    [
        ([False] * 5 + [True], [True], ""),  # a tray as dark as the table
        ([False], [True], "the bench is not seen"),
        ([False] * 5 + [True], [False] * 5 + [True], "the bench is not seen"),  # a camera that swings
        ([False] * 5 + [True] + [False] * 90, [True], "the bench is not seen"),  # faint, then moved
    ],
)
def test_an_edge_that_comes_and_goes_by_itself_is_faint_and_no_camera_that_was_moved(
    frames: list[Frame], faint: list[bool], steady: list[bool], unseen: str
) -> None:
    scene, image = SceneConsistency(BENCH, PRODUCT), frames[0].image
    small: Any = cv2.resize(image, None, fx=1 / TILE, fy=1 / TILE, interpolation=cv2.INTER_AREA)
    grey: Any = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    first, second, *rest = scene._always
    ways = iter([True] * 5), cycle(steady), cycle(faint)

    def seen(*_: object) -> dict[int, bool]:
        if next(ways[0], False):
            return dict.fromkeys(scene._missing, True) | dict.fromkeys(scene._always, True)
        return {first: next(ways[1]), second: next(ways[2])} | dict.fromkeys(rest, True)

    vars(scene)["_landmarks"] = SimpleNamespace(seen=seen)
    said = []
    for number in range(600):
        scene.see(replace(frames[0], sequence=number, time_s=number / 15), small, grey, ())
        said.append(scene.unseen)
    assert set(said) - {""} == ({unseen} if unseen else set())
