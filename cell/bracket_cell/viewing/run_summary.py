"""How a run ended, in words: what `cell run` says last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bracket_ground.interfaces.product import Product

Rows = dict[str, str]


def run_summary(summary: Mapping[str, Any], product: Product, tick_hz: float) -> Rows:
    """Rows for people, by their headings.

    Args:
        summary: the keys of `cell run --json`.
    """
    rows: Rows = {"result": _result(summary)}
    headings = {"cause": "why", "condition": "arm and gripper", "log_shortfall": "the log lacks", "injected": "fault"}
    rows |= {heading: str(summary[key]) for key, heading in headings.items() if summary.get(key)}
    if problems := summary.get("observer_problems"):
        rows["beside the run"] = "; ".join(map(str, problems))
    if summary.get("brackets"):
        rows |= _shift(summary)
    elif "placements" in summary:
        rows |= _assembly(summary, product)
    if summary.get("contacts"):
        rows["contacts"] = f"{summary['contacts']} of hand and robot, up to {summary['contact_speed_m_s']:.2f} m/s"
    rows["time"] = (
        f"{summary['sim_time_s']:.1f} s in the cell, {summary['wall_time_s']:.1f} s on the clock "
        f"({summary['real_time_factor']:.1f} x real time)"
    )
    late = f"{summary['overruns'] or 'none'} of them took longer than the {1000 / tick_hz:.0f} ms that they have"
    rows["ticks"] = f"{summary['ticks']}, {late}"
    if summary.get("late_causes"):
        rows["late"] = _lateness(summary)
    rows["log"] = str(summary["log"]) + (f" and {summary['log_parts'] - 1} more" if summary["log_parts"] > 1 else "")
    if summary["contact_sheet"]:
        rows["contact sheet"] = str(summary["contact_sheet"])
    return rows


def _lateness(summary: Mapping[str, Any]) -> str:
    """How late ticks began, and why."""
    words = f"{summary['late_p50_s'] * 1e3:.1f} ms in the middle, 99 % under {summary['late_p99_s'] * 1e3:.1f} ms"
    words += f", most {summary['late_max_s'] * 1e3:.0f} ms; by cause: "
    words += ", ".join(f"{cause} {count}" for cause, count in summary["late_causes"].items())
    lost_s = summary["world_lost_s"]
    return words + (f"; the simulated world lost {lost_s:.1f} s" if lost_s >= 0.1 else "")


def _result(summary: Mapping[str, Any]) -> str:
    if not summary["finished"]:
        return f"{summary['end']}: {summary['reason']}"
    if summary.get("brackets") or not summary.get("placements") or summary.get("correct") is None:
        return "finished"
    return "finished, and the bracket is right" if summary.get("correct") else "finished, but the bracket is not right"


def _assembly(summary: Mapping[str, Any], product: Product) -> Rows:
    placed = summary["placements"]
    by_hole = ", ".join(f"{hole} {product.title(placed[hole])}" for hole in product.positions if hole in placed)
    inferred, judged = summary.get("inferred_goal"), summary.get("correct") is not None
    right = "the same" if inferred == summary["goal"] else inferred
    goal = {"goal": f"the person built {summary['goal']}; the cell inferred {right}"} if judged else {}
    rows = {
        **goal,
        "in the bracket": by_hole or "nothing",
        "placed by": f"robot {summary['robot_placements']}, person {summary['human_placements']}",
    }
    if judged and summary["wrong_placements"]:
        rows["wrong placements"] = str(summary["wrong_placements"])
    rows["calls for help"] = str(summary["help_requests"] or "none")
    return rows


def _shift(summary: Mapping[str, Any]) -> Rows:
    """Of brackets one after the other: how many came right, who placed the parts, what was asked."""
    done: Sequence[Mapping[str, Any]] = summary["brackets"]
    finished = [bracket for bracket in done if bracket["finished"]]
    lines = [f"{len(done)} begun, {len(finished)} finished"]
    judged = any(bracket.get("correct") is not None for bracket in done)
    lines += [f"{summary[word]} {word}" for word in ("right", "wrong") if judged and (summary[word] or word == "right")]
    rows = {"brackets": ", ".join(lines)}
    if known := [
        f"{bracket['number']} ({', '.join(bracket['known_wrong'])})" for bracket in done if bracket.get("known_wrong")
    ]:
        rows["known to be wrong"] = f"bracket {'; '.join(known)}"
    if took_s := [bracket["sim_time_s"] for bracket in finished]:
        rows["a bracket took"] = f"{sum(took_s) / len(took_s):.0f} s on average, {max(took_s):.0f} s at most"
    by = {who: sum(bracket.get(f"{who}_placements") or 0 for bracket in done) for who in ("robot", "human")}
    rows["placed by"] = f"robot {by['robot']}, person {by['human']}"
    rows["questions"] = str(summary["asked"] or "none")
    return rows
