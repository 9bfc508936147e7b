"""Gives the nodes their services from a configuration: planners, guard, motion; for a run and for its replay alike."""

from __future__ import annotations

from cell.configuration import Configuration
from cell.interfaces.clock import Clock
from cell.interfaces.journal import Journal
from cell.interfaces.observation import Observation
from cell.interfaces.product import Product
from learned.grasp.planner import load_grasp_planner
from learned.semantic.planner import load_semantic_planner
from skills.planner import MotionPlanner
from trees.guard import Guard
from trees.nodes.services import Services


class TickClock:
    """The time of the tick under way: all nodes of a tick read one time, and it is in the log."""

    def __init__(self, services: Services) -> None:
        self._services = services

    def now_s(self) -> float:
        return self._services.observation.time_s

    def sleep_until(self, time_s: float) -> None:
        """Nodes never wait; the next tick brings another time."""


def make_services(
    configuration: Configuration,
    product: Product,
    motion: MotionPlanner,
    clock: Clock,
    journal: Journal,
    observation: Observation,
) -> Services:
    """Services with the planners that the configuration names.

    Raises:
        ModelError: weights are missing or do not fit the product.
    """
    semantic, grasp = configuration.planners.semantic, configuration.planners.grasp
    assert semantic.weights is not None
    assert grasp.weights is not None
    return Services(
        product=product,
        bench=configuration.bench,
        clock=clock,
        motion=motion,
        semantic=load_semantic_planner(semantic.kind, semantic.weights, product),
        rule_semantic=load_semantic_planner("bayes", None, product),
        grasp=load_grasp_planner(grasp.kind, grasp.weights, product),
        rule_grasp=load_grasp_planner("rule", grasp.weights, product),
        guard=Guard(product, configuration.guard),
        journal=journal,
        observation=observation,
    )
