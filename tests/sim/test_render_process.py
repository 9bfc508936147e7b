"""Frames and answers of the render process are those of one process; when it fails, everyone who waits is told."""

from __future__ import annotations

import os
import pickle
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.remote.detecting import PLACES, DetectByCamera
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Action, BenchView, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering import render_process
from bracket_sim.rendering.camera import SimCamera
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.render_process import HURRIED, RenderProcess
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.look import Camera
from bracket_sim.scene.world import World, build_world
from tests import ROOT

FRAMES = 2 * PLACES + 1
PERIOD_S = 0.2
PATIENCE_S = 30.0


def brightness(frame: Frame) -> BenchView:
    """An answer that tells the number of the frame, and how bright it is."""
    return BenchView(frame.sequence, float(frame.image.sum()), None, {}, Action("idle", 1.0))


def build_brightness() -> DetectByCamera:
    return {"overhead": brightness, "wrist": brightness}


def build_refusing() -> DetectByCamera:
    raise InputError("no such product")


def failing(frame: Frame) -> BenchView:
    return BenchView(frame.sequence // 0, 0.0, None, {}, Action("idle", 1.0))


def build_failing() -> DetectByCamera:
    return {"overhead": failing, "wrist": failing}


def told(answer: BenchView | PartsView) -> tuple[int, int]:
    return answer.sequence, int(answer.time_s)


def sensors(bench: Bench) -> dict[str, SensorSetup]:
    return {
        name: SensorSetup(setup, Camera(), np.random.default_rng(number))
        for number, (name, setup) in enumerate([("overhead", bench.overhead), ("wrist", bench.wrist)])
    }


@pytest.fixture(scope="module")
def world(product: Product, bench: Bench) -> World:
    return build_world(product, bench)


@pytest.fixture
def process(world: World, bench: Bench) -> Iterator[RenderProcess]:
    with closing(RenderProcess(world.model, sensors(bench), build_brightness)) as made:
        yield made


def taken(world: World, bench: Bench, maker: RenderProcess | Photographer, times: int = FRAMES) -> list[Frame]:
    """Frames of both cameras while the arm turns, the wrist's after the overhead's."""
    overhead = SimCamera("overhead", bench.overhead, world, maker.take)
    wrist = SimCamera("wrist", bench.wrist, world, maker.take)
    frames = []
    for number in range(times):
        world.set_arm(np.array(bench.arm_look_rad) + 0.02 * number)
        wrist.trigger()
        for camera in (overhead, wrist):
            camera.observe(number * PERIOD_S)
            frame = camera.latest()
            assert frame is not None
            frames.append(frame)
    return frames


def test_frames_are_those_of_one_process(world: World, bench: Bench, process: RenderProcess) -> None:
    with closing(Photographer(world.model, sensors(bench))) as photographer:
        expected = taken(world, bench, photographer)
    frames = taken(world, bench, process)
    assert len(frames) == 2 * FRAMES
    for frame, other in zip(frames, expected, strict=True):
        assert (frame.camera, frame.sequence, frame.time_s) == (other.camera, other.sequence, other.time_s)
        assert frame.world_from_camera == other.world_from_camera
        assert (frame.image == other.image).all()
    assert (frames[0].image != frames[2].image).any()
    sent = pickle.loads(pickle.dumps(frames[-1]))
    assert type(sent) is Frame
    assert (sent.image == expected[-1].image).all()


def test_a_hosted_detector_reads_the_frames_that_it_is_sent(world: World, bench: Bench, process: RenderProcess) -> None:
    frames = taken(world, bench, process)[-6:]
    answers = [process.begin(frame) for frame in frames]
    expected = [(frame.sequence, int(frame.image.sum())) for frame in frames]
    assert [told(answer()) for answer in answers] == expected


def test_another_image_in_the_place_of_a_frames_is_what_a_detector_sees(
    world: World, bench: Bench, process: RenderProcess
) -> None:
    """A camera that is made to fail hands over frames of the same number."""
    frame = taken(world, bench, process)[-1]
    black = Frame(frame.camera, frame.sequence, frame.time_s, np.zeros_like(frame.image), frame.world_from_camera)
    assert told(process.begin(black)()) == (frame.sequence, 0)


class Prepared:
    """Tells whether the image that it is asked about was prepared."""

    def __init__(self) -> None:
        self._images: list[object] = []

    def prepare(self, image: object) -> None:
        self._images.append(image)

    def __call__(self, frame: Frame) -> BenchView:
        known = any(image is frame.image for image in self._images)
        return replace(brightness(frame), health="prepared" if known else "new")


def build_prepared() -> DetectByCamera:
    return {"overhead": Prepared(), "wrist": Prepared()}


def test_a_detector_begins_before_it_is_asked(world: World, bench: Bench) -> None:
    """With all that was taken until a frame is asked about, once it has read one of this camera."""
    with closing(RenderProcess(world.model, sensors(bench), build_prepared)) as process:
        frames = [frame for frame in taken(world, bench, process) if frame.camera == "overhead"]
        answers = [told(process.begin(frame)()) for frame in frames[-3:]]
        assert answers == [(frame.sequence, int(frame.image.sum())) for frame in frames[-3:]]
        exposure = Exposure("overhead", FRAMES, 100.0, Pose((0.0, 0.0, 1.0)), (visible_poses(world.data),))
        newest = process.take(exposure)
        assert newest is not None
        process.begin(frames[-1])()
        answer = process.begin(newest)()
        assert isinstance(answer, BenchView)
        assert (told(answer), answer.health) == ((FRAMES, int(newest.image.sum())), "prepared")


COPIED = """
import signal, sys
from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.remote.child import may_copy
from bracket_sim.rendering.render_process import RenderProcess
from bracket_sim.scene.world import build_world
from tests.sim.test_render_process import build_brightness, sensors
configuration = load_configuration()
world = build_world(load_product(configuration), configuration.bench)
assert may_copy()
process = RenderProcess(world.model, sensors(configuration.bench), build_brightness)
print(*process.process_ids, flush=True)
signal.pause()
"""


def test_copies_of_the_controllers_process_end_with_it() -> None:
    controller = subprocess.Popen([sys.executable, "-c", COPIED], stdout=subprocess.PIPE, cwd=ROOT)
    assert controller.stdout is not None
    copies = [os.pidfd_open(int(number)) for number in controller.stdout.readline().split()]
    try:
        assert select.select(copies, [], [], 0) == ([], [], [])
        controller.kill()
        for copy in copies:
            assert select.select([copy], [], [], PATIENCE_S)[0] == [copy]
    finally:
        controller.kill()
        for copy in copies:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(copy, signal.SIGKILL)
            os.close(copy)
        controller.stdout.close()
        controller.wait()


def test_what_a_detector_says_about_the_users_files_comes_back(world: World, bench: Bench) -> None:
    with closing(RenderProcess(world.model, sensors(bench), build_refusing)) as process:
        frame = taken(world, bench, process)[-1]
        with pytest.raises(InputError, match="no such product"):
            process.begin(frame)()


def test_a_detector_that_fails_is_a_fault(world: World, bench: Bench) -> None:
    with closing(RenderProcess(world.model, sensors(bench), build_failing)) as process:
        answer = process.begin(taken(world, bench, process)[-1])
        with pytest.raises(DeviceFault, match="ZeroDivisionError"):
            answer()


def test_all_that_wait_for_a_process_that_died_are_told(world: World, bench: Bench, process: RenderProcess) -> None:
    camera = SimCamera("overhead", bench.overhead, world, process.take)
    camera.observe(0.0)
    assert missing(camera).image.any()
    drawing, detecting = process.process_ids
    os.kill(detecting, signal.SIGKILL)
    with pytest.raises(DeviceFault, match=rf"detector \(pid {detecting}\): it died"):
        process.begin(missing(camera))()
    os.kill(drawing, signal.SIGKILL)
    camera.observe(PERIOD_S)  # time goes on
    with pytest.raises(DeviceFault, match=rf"renderer \(pid {drawing}\): it died"):
        missing(camera).image.sum()


DIES_AT_ONCE = """
import sys, threading
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import DeviceFault
from bracket_sim.rendering.camera import SimCamera
from bracket_sim.rendering.render_process import RenderProcess
from bracket_sim.scene.world import build_world
from tests.sim.test_render_process import missing, sensors
configuration = load_configuration()
world = build_world(load_product(configuration), configuration.bench)
sys.executable = "/bin/false"
threading.Thread(target=threading.Event().wait, daemon=True).start()  # so that no process begins as a copy
process = RenderProcess(world.model, sensors(configuration.bench))
camera = SimCamera("overhead", configuration.bench.overhead, world, process.take)
try:
    camera.observe(0.0)
    missing(camera).image.sum()
except DeviceFault as fault:
    print(fault)
process.close()
"""


def test_a_process_that_dies_as_it_begins_is_told_and_waited_for_by_nobody() -> None:
    command = [sys.executable, "-c", DIES_AT_ONCE]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE_S)
    assert re.fullmatch(r"renderer \(pid \d+\): it died \(exit code 1\)\n", ended.stdout), ended.stderr


def test_an_answer_does_not_wait_for_a_frame_that_is_never_drawn(
    world: World, bench: Bench, process: RenderProcess
) -> None:
    os.kill(process.process_ids[0], signal.SIGSTOP)  # so that it cannot draw before it dies
    camera = SimCamera("overhead", bench.overhead, world, process.take)
    camera.observe(0.0)
    answer = process.begin(missing(camera))
    os.kill(process.process_ids[0], signal.SIGKILL)
    with pytest.raises(DeviceFault, match=r"renderer .*: it died"):
        answer()


def test_a_frame_is_read_after_its_place_was_used_again(world: World, bench: Bench, process: RenderProcess) -> None:
    frames = taken(world, bench, process)
    assert [told(process.begin(frame)()) for frame in frames[:2]] == [
        (frame.sequence, int(frame.image.sum())) for frame in frames[:2]
    ]


def test_a_place_is_used_again_when_its_readers_are_done(world: World, bench: Bench, process: RenderProcess) -> None:
    camera = SimCamera("overhead", bench.overhead, world, process.take)
    asked = []
    for number in range(FRAMES):
        world.set_arm(np.array(bench.arm_look_rad) + 0.02 * number)
        camera.observe(number * PERIOD_S)
        asked.append((missing(camera), process.begin(missing(camera))))
    for frame, answer in asked:
        assert told(answer()) == (frame.sequence, int(frame.image.sum()))


def missing(camera: SimCamera) -> Frame:
    frame = camera.latest()
    assert frame is not None
    return frame


def test_interrupts_are_the_controllers_to_handle(world: World, bench: Bench, process: RenderProcess) -> None:
    process.await_ready()
    for number in process.process_ids:
        os.kill(number, signal.SIGINT)
        os.kill(number, signal.SIGTERM)
    frame = taken(world, bench, process)[-1]
    assert told(process.begin(frame)()) == (frame.sequence, int(frame.image.sum()))


def test_frames_are_left_out_where_time_does_not_wait(world: World, process: RenderProcess) -> None:
    process.await_ready()
    process.hurried = True
    os.kill(process.process_ids[0], signal.SIGSTOP)
    poses = visible_poses(world.data)
    exposures = [Exposure("wrist", number, 0.0, Pose((0.0, 0.0, 0.0)), (poses,)) for number in range(HURRIED + 2)]
    frames = [process.take(exposure) for exposure in exposures]
    assert frames[-1] is None


def test_a_process_that_draws_nothing_is_named_and_may_go_on(
    world: World, bench: Bench, process: RenderProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render_process, "SILENT_S", 0.0)
    process.await_ready()
    drawing, process.hurried = process.process_ids[0], True
    camera = SimCamera("overhead", bench.overhead, world, process.take)
    os.kill(drawing, signal.SIGSTOP)
    camera.observe(0.0)
    camera.observe(PERIOD_S)
    with pytest.raises(DeviceFault, match=rf"renderer \(pid {drawing}\): does not answer for 0\.\d s"):
        camera.latest()
    os.kill(drawing, signal.SIGCONT)
    process.hurried = False  # it catches up
    camera.observe(2 * PERIOD_S)
    assert missing(camera).image.any()
