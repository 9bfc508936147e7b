"""Whole assemblies with the detectors in the loop: the paper's Table 1, by the number of goals that are possible.

AD: placements of the person that were told, part and hole right, within a second and once, by the hand's movement or
by the hole that it filled; AD_by_hand: those of them that no hole had to tell. SG: placements that the
robot was allowed to make that belong to the person's goal. SC: assemblies that end with the right part in every hole.
Corrected: the SC of those in which the person took a wrong part, or took one out of its hole again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bracket_cell.configuration import Configuration, load_product
from bracket_cell.watching.observer import Observer, TickRecord
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import Action
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.actions import Told, matched
from bracket_lab.evaluations.assembly import opened
from bracket_lab.evaluations.figures import paper
from bracket_lab.evaluations.holes_and_parts import calibrated_bench
from bracket_lab.learned.scores import share
from bracket_sim.cell import SimCell


@dataclass
class Listener(Observer):
    """An observer that keeps which placements were told, and which the robot was allowed to make."""

    told: list[Told] = field(default_factory=list)
    by_hand: list[Told] = field(default_factory=list)
    allowed: list[tuple[str, str]] = field(default_factory=list)
    contradictions: int = 0
    _before: Action | None = None

    def tick(self, record: TickRecord) -> None:
        view = record.observation.bench
        if view is not None:
            action, before = view.action, self._before
            self._before = action if action.finished else None
            new = before is None or (before.part, before.position) != (action.part, action.position)
            if action.finished and new and action.part and action.position:
                self.told.append((view.time_s, action.part, action.position))
                self.by_hand += [] if action.shown else self.told[-1:]
        for topic, fields in record.notes:
            if topic == "verdict" and fields.get("decision") == "act":
                self.allowed.append((str(fields["part"]), str(fields["position"])))
            self.contradictions += topic == "belief" and fields.get("outcome") == "looked at again"


def with_goals(product: Product, count: int) -> Product:
    """The product with its first goals alone.

    Raises:
        InputError: it has fewer.
    """
    if not 1 <= count <= len(product.goals):
        raise InputError(f"{count} goals: {product.name!r} has {len(product.goals)}")
    return product.model_copy(update={"goals": dict(list(product.goals.items())[:count])})


def evaluate_system(
    configuration: Configuration,
    path: Path,
    tree: Path,
    count: int,
    seed: int,
    *,
    calibrated: bool = True,
    pixels: bool = True,
) -> dict[str, Any]:
    """The row of one assembly.

    Args:
        path: the configuration's file.
        tree: file of the tree that is run.
        count: how many goals are possible.
        calibrated: the cameras were calibrated in it, as `cell setup calibrate` does; else they hang elsewhere
            than the bench file says, as the look has it.
        pixels: cameras are rendered; else hands, holes and parts are told from the truth, and the classical detector
            names actions from these.
    """
    product = load_product(configuration, path)
    if calibrated and pixels:
        configuration = configuration.model_copy(update={"bench": _calibrated(configuration, product, seed)})
    found = assemble(configuration, with_goals(product, count), tree, seed, pixels=pixels)
    return {"goals": count, "seed": seed, **found}


_last: tuple[Configuration, Product, int, Bench] | None = None


def _calibrated(configuration: Configuration, product: Product, seed: int) -> Bench:
    """Cameras as they are calibrated in a look; the last one is kept, as a seed is run for several numbers of goals."""
    global _last
    if _last is None or _last[:3] != (configuration, product, seed):
        _last = configuration, product, seed, calibrated_bench(configuration, product, seed)
    return _last[3]


def assemble(
    configuration: Configuration, product: Product, tree_file: Path, seed: int, *, pixels: bool = True
) -> dict[str, Any]:
    """One assembly, of a goal that the seed draws."""
    listener = Listener()
    with opened(configuration, product, tree_file, seed, rendered=pixels) as found:
        cell = found.cell
        try:
            outcome = found.run([listener], None)
            end, reason, sim_time_s = outcome.end, outcome.reason, outcome.sim_time_s
        except DeviceFault as error:
            end, reason, sim_time_s = "fault", str(error), 0.0
    goal = {(part, position) for position, part in product.goal_placements(cell.score.goal).items()}
    placed = _placed(cell)
    right = len(matched(placed, listener.told))
    return {
        "goal": cell.score.goal,
        "end": end,
        "reason": reason,
        "correct": bool(cell.score.report()["correct"]) and end == "finished",
        "placed": len(placed),
        "told": len(listener.told),
        "told_right": right,
        "told_right_by_hand": len(matched(placed, listener.by_hand)),
        "allowed": len(listener.allowed),
        "allowed_right": sum(kind in goal for kind in listener.allowed),
        "contradictions": listener.contradictions,
        "lapses": _lapses(cell),
        "robot_placements": cell.score.report().get("robot_placements"),
        "sim_time_s": round(sim_time_s, 2),
    }


def _placed(cell: SimCell) -> list[Told]:
    """What the person's fingers let go over holes."""
    acts = cell.worker.acts if cell.worker is not None else []
    return [
        (event.time_s, str(event.fields["part"]), str(event.fields["position"]))
        for event in acts
        if event.fields.get("act") == "release" and event.fields.get("position") is not None
    ]


def _lapses(cell: SimCell) -> int:
    """How often the person took a wrong part, or took one out of its hole again."""
    acts = cell.worker.acts if cell.worker is not None else []
    return sum(event.fields.get("act") in ("wrong part", "take away") for event in acts)


def table_1(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """AD, SG and SC by the number of goals, each with its interval; beside them the paper's, where it is known."""
    found: dict[str, Any] = {}
    rows = list(rows)
    for count in sorted({row["goals"] for row in rows}):
        of_count = [row for row in rows if row["goals"] == count]
        total = {name: sum(row[name] for row in of_count) for name in _COUNTS}
        found[str(count)] = {
            "assemblies": len(of_count),
            "AD": share(total["told_right"], total["placed"]),
            **_by_hand(of_count),
            "false_per_100": round(100 * (total["told"] - total["told_right"]) / max(1, total["placed"]), 2),
            "SG": share(total["allowed_right"], total["allowed"]),
            "SC": share(sum(row["correct"] for row in of_count), len(of_count)),
            "contradictions": total["contradictions"],
            **_corrected(of_count),
            **_printed(count),
            "not_finished": sum(row["end"] != "finished" for row in of_count),
        }
    return found


def _printed(count: int) -> dict[str, Any]:
    """The paper's figures for as many goals; nothing where it has none."""
    found = paper().tables["Table 1"].rows.get(f"{count} goal{'s' * (count > 1)}")
    return {} if found is None else {"paper": ", ".join(f"{name} {value}" for name, value in found.items())}


def _by_hand(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Nothing where rows are older than that count."""
    rows = [row for row in rows if "told_right_by_hand" in row]
    right, placed = (sum(row[name] for row in rows) for name in ("told_right_by_hand", "placed"))
    return {"AD_by_hand": share(right, placed)} if rows else {}


def _corrected(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Nothing where the person made no mistake, or where rows are older than that count."""
    erred = [row for row in rows if row.get("lapses")]
    return {"corrected": share(sum(row["correct"] for row in erred), len(erred))} if erred else {}


_COUNTS = ("told_right", "placed", "told", "allowed_right", "allowed", "contradictions")
