"""Makes the detectors that the configuration names, and the executors that run them."""

from __future__ import annotations

from collections.abc import Callable

from cell.configuration import Perception
from cell.interfaces.bench import Bench
from cell.interfaces.clock import Clock
from cell.interfaces.perception import BenchView, Frame, PartDetector, PartsView
from cell.interfaces.product import Product
from cell.running.inference import Executor, LockStep, WorkerProcess
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
    bench: Bench, product: Product, perception: Perception, clock: Clock
) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
    """Executors for simulation: answers come a configured latency later in clock time."""
    watch, find = bench_watcher(bench, product, perception), part_finder(bench, product, perception)
    return LockStep(watch, clock, perception.latency_s), LockStep(find, clock, perception.latency_s)


def worker_processes(
    bench: Bench, product: Product, perception: Perception
) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
    """Executors for real time: each detector in a process of its own."""
    return (
        WorkerProcess("bench watcher", bench_watcher, bench, product, perception),
        WorkerProcess("part detector", part_finder, bench, product, perception),
    )
