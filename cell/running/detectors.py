"""Makes the detectors that the configuration names, and the executors that run them."""

from __future__ import annotations

from collections.abc import Callable

from cell.configuration import Perception
from cell.interfaces.bench import Bench
from cell.interfaces.devices import Devices
from cell.interfaces.perception import BenchView, Frame, PartDetector, PartsView
from cell.interfaces.product import Product
from cell.running.inference import Executor, HeldBack, LockStep, WorkerProcess
from learned.classical.bench_watcher import ClassicalBenchWatcher
from learned.classical.part_detector import ClassicalPartDetector


def bench_watcher(bench: Bench, product: Product, perception: Perception) -> Callable[[Frame], BenchView]:
    """What answers overhead frames."""
    return ClassicalBenchWatcher(bench, product, perception.classical).watch


def part_finder(bench: Bench, product: Product, perception: Perception) -> Callable[[Frame], PartsView]:
    """What answers wrist frames."""
    detector: PartDetector = ClassicalPartDetector(bench, product, perception.classical)
    return lambda frame: PartsView(frame.sequence, frame.time_s, detector.detect(frame))


def lock_step(
    bench: Bench, product: Product, perception: Perception, devices: Devices
) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
    """Executors for simulation: answers come a configured latency later in clock time.

    The detectors run beside the physics where the devices offer a place for it; the answers are the same.
    """
    clock, latency_s, arguments = devices.clock, perception.latency_s, (bench, product, perception)
    if devices.host is None:
        watch, find = bench_watcher(*arguments), part_finder(*arguments)
        return LockStep(watch, clock, latency_s), LockStep(find, clock, latency_s)
    return (
        HeldBack(devices.host.host(bench_watcher, *arguments), clock, latency_s),
        HeldBack(devices.host.host(part_finder, *arguments), clock, latency_s),
    )


def worker_processes(
    bench: Bench, product: Product, perception: Perception
) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
    """Executors for real time: each detector in a process of its own."""
    return (
        WorkerProcess("bench watcher", bench_watcher, bench, product, perception),
        WorkerProcess("part detector", part_finder, bench, product, perception),
    )
