"""How detectors fare when one value of the look, or the person's speed, is turned and the rest stays as it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.figure import Figure

from bracket_cell.configuration import Configuration
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.errors import InputError
from bracket_ground.interfaces.perception import HandTracker
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.actions import at_pace, evaluate_actions
from bracket_lab.evaluations.actions import share as share_of
from bracket_lab.evaluations.hands import evaluate_hands
from bracket_lab.evaluations.holes_and_parts import Task, score_holes, score_parts
from bracket_sim.scene.settings import settings_of

PACE = "pace"  # of the person, by which they are faster than usual: the knob that no look has
LEAST_PACE, MOST_PACE = 0.2, 5.0
STILLS, STRETCHES = 6, 2  # of a seed

# Turned where a user names no knob; from the look nominal to beyond what is trained on.
LIGHT: Mapping[str, tuple[float, ...]] = {
    "light.ambient": (0.05, 0.15, 0.35, 0.7),
    "camera.brightness_ev": (-2.5, -1.0, 0.0, 1.0, 2.0),
    "camera.blue_gain": (0.6, 0.8, 1.0, 1.3, 1.7),
    "camera.noise_levels": (2.0, 8.0, 16.0, 30.0),
    "camera.blur_px": (0.6, 1.5, 2.5, 4.0),
}
MOVING: Mapping[str, tuple[float, ...]] = {
    "camera.exposure_s": (0.0, 0.02, 0.04),
    "camera.dropped_share": (0.0, 0.1, 0.3),
    PACE: (1.0, 1.5, 2.0),
}
PERSON: Mapping[str, tuple[float, ...]] = {
    "person.skin_tone": (0.0, 0.4, 0.8, 1.0),
    "person.hand_size": (0.85, 1.0, 1.15),
    "person.lean_m": (0.0, 0.1, 0.2),
}
PAINT: Mapping[str, tuple[float, ...]] = {
    "surfaces.paint_fade": (0.0, 0.3, 0.6, 0.9),
    "surfaces.paint_lightness": (0.6, 1.0, 1.4),
}


@dataclass(frozen=True)
class Sample:
    """What a detector is scored on.

    Attributes:
        physics: hands move by it, so that frames are blurred as the look says; else by rule, much faster.
    """

    configuration: Configuration
    product: Product
    seeds: Sequence[int]
    physics: bool = True


Score = Callable[[Sample], dict[str, Any]]


def at(configuration: Configuration, knob: str, value: Any) -> Configuration:
    """The same cell with a knob turned.

    Raises:
        InputError: there is no such knob, or the value is not legal.
    """
    if knob == PACE:
        if not isinstance(value, int | float) or not LEAST_PACE <= value <= MOST_PACE:
            raise InputError(f"{PACE}: {value!r}; legal: {LEAST_PACE} to {MOST_PACE}")
        return at_pace(configuration, value)
    devices = configuration.devices
    look = settings_of(devices.simulation).look.fixed(knob, value)
    simulation = settings_of(devices.simulation).model_copy(update={"look": look})
    return configuration.model_copy(update={"devices": devices.model_copy(update={"simulation": simulation})})


def _actions(of: Sample) -> dict[str, Any]:
    kind, perception = of.configuration.perception.chosen("actions").kind, of.configuration.perception
    weights = {kind: perception.weights("actions")} if kind != "classical" else {}
    tallies = evaluate_actions(of.configuration, of.product, [kind], of.seeds, physics=of.physics, weights=weights)
    found = tallies[kind].summary(Classes.of(of.product))
    placements = found["placements"]
    return {**found["outside_guard"], "beside": placements["share"] if placements["n"] else None}


def _hands(of: Sample) -> dict[str, Any]:
    def make(bench: Any) -> HandTracker:
        tracker: HandTracker = Detectors(bench, of.product, of.configuration.perception).make("hands")
        return tracker

    makers = {"": make}
    scores = evaluate_hands(of.configuration, of.product, makers, of.seeds, stretches=STRETCHES, physics=of.physics)
    found = scores[""]
    told = {name: found[f"found{end}"] for name, end in (("share", ""), ("low", "_low"), ("high", "_high"))}
    return {**told, "n": found["found_n"], "beside": found.get("palm_mm_p95")}


def _holes(of: Sample) -> dict[str, Any]:
    chosen = of.configuration.perception.chosen("holes")
    found = score_holes(Task(of.configuration, of.product, chosen.kind, chosen.weights), of.seeds, STILLS)
    told = {name: round(found[f"right{end}"], 4) for name, end in (("share", ""), ("low", "_low"), ("high", "_high"))}
    return {**told, "n": int(found["holes"]), "beside": found.get("right_where_said")}


def _parts(of: Sample) -> dict[str, Any]:
    chosen = of.configuration.perception.chosen("parts")
    found = score_parts(Task(of.configuration, of.product, chosen.kind, chosen.weights), of.seeds, mixed=True)
    count = int(found["standing"])
    told = share_of(round(count * (1 - found.get("missed", 0))), count)
    return {**told, "beside": found.get("position_mm_p95")}


@dataclass(frozen=True)
class Scored:
    """How one detector is scored.

    Attributes:
        score: of a sample: `share`, its interval `low` and `high`, `n`, and another figure, `beside`.
        title: what `share` is.
        beside: what the other figure is.
        knobs: values by knob that are tried by default.
    """

    score: Score
    title: str
    beside: str
    knobs: Mapping[str, tuple[float, ...]]


SCORED: Mapping[str, Scored] = {
    "actions": Scored(_actions, "segments named right, outside the guard band", "placements told in time", MOVING),
    "hands": Scored(_hands, "hands found", "palm error, 95 % [mm]", {**LIGHT, **PERSON, **MOVING}),
    "holes": Scored(_holes, "bare holes right", "right where said", {**LIGHT, **PAINT}),
    "parts": Scored(_parts, "standing parts found", "position error, 95 % [mm]", {**LIGHT, **PAINT}),
}


COLUMNS, PANEL_INCHES = 4, (2.6, 2.1)
TITLE_LETTERS = 28  # over a panel


def plot_knobs(rows: Sequence[dict[str, Any]], title: str, path: Path) -> None:
    """Draw rows with `knob`, `value`, `share`, `low`, `high` and, on an axis of its own, `beside` into a PNG file."""
    names = list(dict.fromkeys(row["knob"] for row in rows))
    columns = min(COLUMNS, len(names))
    lines = -(-len(names) // columns)
    figure = Figure(figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * lines + 0.4), layout="constrained")
    panels = figure.subplots(lines, columns, sharey=True, squeeze=False).ravel()
    most = max((row["beside"] for row in rows if row["beside"] is not None), default=1.0)
    for name, panel in zip(names, panels, strict=False):
        own = [row for row in rows if row["knob"] == name]
        shares = [row["share"] for row in own]
        reach = ([row["share"] - row["low"] for row in own], [row["high"] - row["share"] for row in own])
        panel.errorbar([row["value"] for row in own], shares, yerr=reach, marker="o", capsize=3)
        panel.set_title(name, fontsize="medium")
        panel.set_ylim(min(0.8, *(row["low"] for row in rows)) - 0.02, 1.02)
        panel.grid(alpha=0.3)
        other = panel.twinx()
        other.plot([row["value"] for row in own], [row["beside"] for row in own], "s--", color="tab:orange", alpha=0.7)
        other.set_ylim(0, 1.1 * most)
        other.tick_params(colors="tab:orange")
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    figure.suptitle(fill(f"{title}; bars: 95 %", TITLE_LETTERS * columns), fontsize="large")
    figure.savefig(path, dpi=110)
