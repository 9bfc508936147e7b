"""A comparison of two trees as lines for a terminal and as one HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bracket_cell.fleet.compare import Finding, differing, findings, overall
from bracket_cell.log.report.html_page import rendered

Row = Mapping[str, Any]
TEMPLATE = Path(__file__).with_name("compare.html.j2")
SHOWN_PAIRS = 60
BY_PERSON = ("right", "time_s", "held_s", "least_distance_m", "contacts", "human_idle")
WORDS = {
    "better": "B is better",
    "worse": "B is worse",
    "mixed": "B is better in one thing and worse in another",
    "no difference proved": "no difference proved",
}


def lines(found: Sequence[Finding], names: tuple[str, str], pairs: int) -> list[str]:
    """The whole comparison for a terminal."""
    told = [f"A {names[0]}, B {names[1]}: {pairs} pairs; {WORDS[overall(found)]}", ""]
    told.append(f"{'':18} {'A':>9} {'B':>9}  {'B - A':>9}  {'95 % interval':>20}")
    for finding in found:
        mark = "*" if finding.measure.judged else " "
        row = f"{finding.measure.name:17}{mark} {_number(finding.one):>9} {_number(finding.other):>9}"
        told.append(f"{row}  {_signed(finding.difference.value):>9}  {_span(finding):>20}  {finding.verdict}")
    told += ["", "* decides which is better; the three share 5 % of false alarms. The others explain, each by itself."]
    return told


def by_person(pairs: Sequence[tuple[Row, Row]]) -> list[str]:
    """What each person brought to the figures that change with who stands at the bench; nothing where one did all."""
    grouped = _grouped(pairs)
    if len(grouped) < 2:
        return []
    told = ["", f"{'person':18} {'':17} {'A':>9} {'B':>9}  {'B - A':>9}  {'95 % interval':>20}"]
    for person, found in grouped.items():
        for finding in found:
            row = f"{person:18} {finding.measure.name:17} {_number(finding.one):>9} {_number(finding.other):>9}"
            told.append(f"{row}  {_signed(finding.difference.value):>9}  {_span(finding):>20}  {finding.verdict}")
    return told


def persons_as_json(pairs: Sequence[tuple[Row, Row]]) -> dict[str, object]:
    """The measures that change with who stands at the bench, by person."""
    return {
        person: {finding.measure.name: {"a": _finite(finding.one), "b": _finite(finding.other)} for finding in found}
        for person, found in _grouped(pairs).items()
    }


def _grouped(pairs: Sequence[tuple[Row, Row]]) -> dict[str, list[Finding]]:
    persons = dict.fromkeys(str(a.get("person") or "as configured") for a, _ in pairs)
    return {
        person: [
            finding
            for finding in findings([two for two in pairs if str(two[0].get("person") or "as configured") == person])
            if finding.measure.name in BY_PERSON
        ]
        for person in persons
    }


def as_json(found: Sequence[Finding], names: tuple[str, str], pairs: int) -> dict[str, object]:
    """Keys of `cell compare --json`."""
    return {
        "a": names[0],
        "b": names[1],
        "pairs": pairs,
        "overall": overall(found),
        "measures": {
            finding.measure.name: {
                "what": finding.measure.what,
                "a": _finite(finding.one),
                "b": _finite(finding.other),
                "difference": _finite(finding.difference.value),
                "low": _finite(finding.difference.low),
                "high": _finite(finding.difference.high),
                "pairs": finding.pairs,
                "verdict": finding.verdict,
            }
            for finding in found
        },
    }


def page(found: Sequence[Finding], names: tuple[str, str], pairs: Sequence[tuple[Row, Row]]) -> str:
    """One HTML page that needs no network: the measures, and the runs in which the two differ."""
    other = differing(pairs)
    return rendered(
        TEMPLATE,
        names=names,
        pairs=len(pairs),
        verdict=WORDS[overall(found)],
        measures=[_measure(finding) for finding in found],
        runs=[_run(a, b) for a, b in other[:SHOWN_PAIRS]],
        left_out=max(0, len(other) - SHOWN_PAIRS),
        differing=len(other),
        times=_times(pairs),
    )


def _measure(finding: Finding) -> dict[str, Any]:
    return {
        "name": finding.measure.name,
        "what": finding.measure.what,
        "judged": finding.measure.judged,
        "a": _number(finding.one),
        "b": _number(finding.other),
        "difference": _signed(finding.difference.value),
        "span": _span(finding),
        "verdict": finding.verdict,
        "pairs": finding.pairs,
    }


def _run(a: Row, b: Row) -> dict[str, Any]:
    def told(row: Row) -> str:
        if row.get("end") != "finished":
            return f"{row.get('end')}: {row.get('cause') or row.get('reason')}"
        right = "right" if row.get("correct") else "wrong"
        return f"{right} in {float(row['sim_time_s']):.1f} s, {row.get('robot_placements')} by the robot"

    more_s = None
    if a.get("end") == b.get("end") == "finished":
        more_s = f"{float(b['sim_time_s']) - float(a['sim_time_s']):+.1f} s"
    return {"seed": a["seed"], "goal": a.get("goal") or "", "a": told(a), "b": told(b), "more_s": more_s or ""}


def _times(pairs: Sequence[tuple[Row, Row]]) -> dict[str, Any]:
    """Dots of a chart: the time of A to the right, that of B upwards, both in [s]."""
    dots = [
        (float(a["sim_time_s"]), float(b["sim_time_s"]), a["seed"])
        for a, b in pairs
        if a.get("end") == b.get("end") == "finished"
    ]
    most = max((max(x, y) for x, y, _ in dots), default=1.0)
    least = min((min(x, y) for x, y, _ in dots), default=0.0)
    span = max(most - least, 1.0)
    scale = [round(least + span * part / 4) for part in range(5)]
    return {
        "dots": [(40 + 300 * (x - least) / span, 320 - 300 * (y - least) / span, seed) for x, y, seed in dots],
        "ticks": [(40 + 300 * (value - least) / span, 320 - 300 * (value - least) / span, value) for value in scale],
    }


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def _signed(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:+.3f}" if abs(value) < 10 else f"{value:+.1f}"


def _span(finding: Finding) -> str:
    low, high = finding.difference.low, finding.difference.high
    return "-" if not (math.isfinite(low) and math.isfinite(high)) else f"{_signed(low)} to {_signed(high)}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
