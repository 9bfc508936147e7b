"""`cell lab eval latency`: what an answer costs."""

from __future__ import annotations

from bracket_lab.wiring.latency import answers_ms


def test_an_answer_about_the_tray_costs_all_that_is_done_with_its_image() -> None:
    rows = ("hands", "holes", "actions", "frame", "parts", "tray")
    found = {name: {"p50_ms": 1.0, "p95_ms": float(number)} for number, name in enumerate(rows)}
    assert answers_ms(found) == {"hands": 0.0, "holes": 1.0, "actions": 2.0, "parts": 5.0}
