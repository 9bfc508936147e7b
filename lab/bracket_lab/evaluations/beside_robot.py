"""Recordings to learn from in which the controller moves the arm beside the person, as in a run."""

from __future__ import annotations

from contextlib import closing

from bracket_cell.configuration import DEFAULT_TREE, Configuration, load_faults
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import drive
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.wiring.devices import attached
from bracket_cell.wiring.services import load_planners
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.recording import Assembly, Film, drawn_goal
from bracket_sim.cell import SimCell
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.rendering.camera import SimCamera
from bracket_sim.scene.settings import settings_of


def record_beside_robot(configuration: Configuration, product: Product, seed: int) -> Assembly:
    """One bracket that person and robot build together, by physics; look, goal and person are drawn from the seed.

    The controller knows hands, holes and parts from the truth: frames are made later, and only those that are wanted.
    """
    bench, bus, goal = configuration.bench, configuration.devices.gripper_bus, drawn_goal(product, seed)
    motion = MotionPlanner(product, bench, configuration.motion)
    tree = load_tree(DEFAULT_TREE, node_registry())
    files = Files(configuration, product, tree, load_planners(configuration, product), load_faults(configuration))
    settings = settings_of(configuration.devices.simulation)
    cell = SimCell(product, bench, settings, *bus, seed, goal, rendered=False, robot=configuration.robot)
    with closing(cell):
        film, camera, worker = Film(cell.world), cell.devices.overhead, cell.worker
        assert isinstance(camera, SimCamera)
        assert worker is not None
        camera.watch = film.keep
        with attached(configuration, product, without_pixels(cell, configuration, product)) as devices:
            outcome = drive(files, devices, motion)
        if outcome.end == "interrupted":  # the controller heard the signal, and ended the run safely
            raise KeyboardInterrupt(outcome.reason)
        return film.assembly(seed, goal, cell.look, worker.events, worker.acts, robot_works=True)
