"""`cell lab data`: training data from the simulated world."""

from __future__ import annotations

from bracket_lab.commands.cuttings import paste
from bracket_lab.commands.hands import compose
from bracket_lab.commands.stacks import draw_stacks
from bracket_lab.commands.training.worlds import data_app as app_of
from bracket_lab.evaluations.reaches import record_beside_robot

data_app = app_of(record_beside_robot)
data_app.info.help = "Make training data."
data_app.command("stacks")(draw_stacks)
data_app.command("photographs")(compose)
data_app.command("sheets")(paste)
