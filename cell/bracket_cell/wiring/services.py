"""Gives the nodes their services from a configuration: planners, guard, motion; for a run and for its replay alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from bracket_cell.configuration import Configuration
from bracket_cell.kinds import made
from bracket_cell.learned.grasp.model import RulePlanner
from bracket_cell.learned.grasp.settings import outline_of
from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_cell.settings import Perception
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.guard import Guard
from bracket_cell.trees.nodes.files import Files, WorkingFolder
from bracket_cell.trees.nodes.services import Policies, Services, Tick, Tools
from bracket_cell.wiring.detectors import card_of
from bracket_ground.errors import InputError, ModelError, SettingError
from bracket_ground.interfaces.memory import Memory
from bracket_ground.interfaces.notes import Journal
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.planning import GraspPlanner, SemanticPlanner
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.outside import LoggedAnswers


class TickClock:
    """The time of the tick under way: all nodes of a tick read one time, and it is in the log."""

    def __init__(self, services: Services) -> None:
        self._services = services

    def now_s(self) -> float:
        return self._services.now.observation.time_s

    def sleep_until(self, time_s: float) -> None:
        """Nodes never wait; the next tick brings another time."""


@dataclass(frozen=True)
class Planners:
    """The chosen planners, and the rule-based ones that answer where those cannot be used.

    Attributes:
        known: the product with the goals that were learned.
        goals, confusions: what the semantic planners were made with.
    """

    semantic: SemanticPlanner
    rule_semantic: SemanticPlanner
    grasp: GraspPlanner
    rule_grasp: GraspPlanner
    known: Product
    goals: OpenGoals
    confusions: Confusions | None = None


def load_planners(configuration: Configuration, product: Product) -> Planners:
    """The planners that the configuration names.

    Raises:
        SettingError: weights are missing or do not fit the product, or there is no such kind; all are reported at once.
    """
    semantic = configuration.planners.semantic

    def load_semantic() -> tuple[SemanticPlanner, SemanticPlanner, OpenGoals, Confusions | None]:
        goals = OpenGoals.of(product, semantic.new_goals)
        if semantic.goals is not None:
            goals = OpenGoals.load(semantic.goals, product, semantic.new_goals)
        layout = Layout.of(product)
        path = semantic.confusions
        confusions = _told(configuration.perception, layout) if path is None else Confusions.load(path, layout)
        chosen = made("semantic", semantic, product=product, goals=goals, confusions=confusions)
        return chosen, BayesPlanner(product, goals, confusions), goals, confusions

    loaders: dict[str, Callable[[], Any]] = {
        "semantic": load_semantic,
        "grasp": partial(made, "grasp", configuration.planners.grasp, product=product, robot=configuration.robot),
    }
    loaded: dict[str, Any] = {}
    problems: list[tuple[tuple[str | int, ...], str]] = []
    for name, load in loaders.items():
        try:
            loaded[name] = load()
        except SettingError as error:
            problems += error.places
        except (InputError, ModelError) as error:
            problems.append((("planners", name), str(error)))
    if problems:
        raise SettingError(*problems)
    chosen, rule, goals, confusions = loaded["semantic"]
    outline = outline_of(configuration.robot.gripper, margins=True)
    return Planners(chosen, rule, loaded["grasp"], RulePlanner(product, outline), goals.product, goals, confusions)


def _told(perception: Perception, layout: Layout) -> Confusions | None:
    """What the chosen action detector takes for what, by its model card; None where there is none, or it is silent.

    Raises:
        ModelError: its weights cannot be read.
    """
    card = card_of(perception, "actions")
    data = None if card is None else card.config.get("confusion")
    return Confusions.counted(layout, data["classes"], data["counts"]) if isinstance(data, dict) else None


def make_services(
    configuration: Configuration,
    planners: Planners,
    motion: MotionPlanner,
    journal: Journal,
    observation: Observation,
    left_off: ResumeState = ResumeState(),  # noqa: B008 - frozen
    files: Files | None = None,
    answers: LoggedAnswers | None = None,
    policies: Policies | None = None,
) -> Services:
    """What the nodes of a tree work with.

    Args:
        left_off: of a run that was broken off and that this one goes on with; empty for a new beginning.
        files: what nodes read and write; the working folder unless given.
        policies: who asks trained policies.
        answers: of a log, in the place of what nodes would ask beyond the cell.
    """
    tools = Tools(
        product=planners.known,
        bench=configuration.bench,
        motion=motion,
        semantic=planners.semantic,
        rule_semantic=planners.rule_semantic,
        grasp=planners.grasp,
        rule_grasp=planners.rule_grasp,
        guard=Guard(planners.known, configuration.guard),
        journal=journal,
        files=files or WorkingFolder(),
        policies=policies,
        answers=answers,
        teach=_teacher(configuration, planners.known, writes=files is None),
        learn=learner(configuration, planners),
    )
    services = Services(Tick(observation), tools, Memory(held_part=left_off.held_part, left_off=left_off))
    for parts in left_off.finished:
        services.learn(parts)
    return services


def _teacher(
    configuration: Configuration, product: Product, *, writes: bool
) -> Callable[[str, tuple[str, ...]], str] | None:
    """Notes goals in the configuration's file of goals; a replay knows them, and leaves the file as it is."""
    settings = configuration.planners.semantic
    if settings.goals is None:
        return None
    path, known = settings.goals, list[OpenGoals]()

    def teach(name: str, parts: tuple[str, ...]) -> str:
        before = known[-1] if known else OpenGoals.load(path, product, settings.new_goals)
        known[:] = [goals := before.with_goal(name, parts)]
        if writes:
            known.clear()  # others may write it, too
            goals.save(path)
        return str(goals.name_of(parts))

    return teach


def learner(
    configuration: Configuration, planners: Planners
) -> Callable[[Tools, tuple[str, ...]], tuple[Tools, str | None]]:
    """What is asked for tools when a bracket was finished: planners and guard know its goal from then on."""
    goals = planners.goals

    def learn(tools: Tools, parts: tuple[str, ...]) -> tuple[Tools, str | None]:
        """The tools, and the name of the goal that the bracket ended in; None where none of this product ends so."""
        nonlocal goals
        try:
            goals = goals.with_bracket(parts)
        except InputError:
            return tools, None
        known = goals.product
        semantic, rule_semantic = (
            planner.with_goals(goals, planners.confusions)
            if isinstance(planner, FactoredPlanner | BayesPlanner)
            else planner
            for planner in (tools.semantic, tools.rule_semantic)
        )
        guard = Guard(known, configuration.guard)
        tools = replace(tools, product=known, semantic=semantic, rule_semantic=rule_semantic, guard=guard)
        return tools, goals.name_of(parts)

    return learn
