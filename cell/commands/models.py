"""`cell train`, `cell eval` and `cell data`: one module of commands for each planner, and one for recorded runs."""

from __future__ import annotations

import typer

from cell.commands import actions as action_commands
from cell.commands import all_weights, same_weights, things, worlds
from cell.commands import data as data_commands
from cell.commands import encounters as encounter_commands
from cell.commands import faults as fault_commands
from cell.commands import figure10 as figure10_commands
from cell.commands import grasp as grasp_commands
from cell.commands import hands as hand_commands
from cell.commands import knobs as knob_commands
from cell.commands import noise as noise_commands
from cell.commands import semantic as semantic_commands
from cell.commands import system as system_commands
from cell.commands import train as train_commands

train_app = typer.Typer(help="Train planners and detectors; without a name, the planners that the product needs.")
train_app.callback(invoke_without_command=True)(train_commands.train_all)
eval_app = typer.Typer(no_args_is_help=True, help="Score planners, detectors and whole assemblies.")
eval_app.command("faults")(fault_commands.faults)
eval_app.command("encounters")(encounter_commands.encounters)
data_app = typer.Typer()
data_app.callback(invoke_without_command=True)(data_commands.from_logs)
data_app.command("semantic")(semantic_commands.data)
data_app.command("grasp")(grasp_commands.data)
train_app.command("all")(all_weights.train_all)
eval_app.command("weights")(same_weights.evaluate_weights)
train_app.command("holes")(things.train_holes)
train_app.command("parts")(things.train_parts)
eval_app.command("holes")(things.evaluate_holes)
eval_app.command("parts")(things.evaluate_parts)
eval_app.command("cameras")(things.evaluate_cameras)
train_app.command("noise")(noise_commands.train)
train_app.command("actions")(action_commands.train)
eval_app.command("actions")(action_commands.evaluate)
eval_app.command("figure10")(figure10_commands.figure10)
eval_app.command("knobs")(knob_commands.knobs)
eval_app.command("system")(system_commands.system)
eval_app.command("latency")(system_commands.latency)
for command in (worlds.actions, worlds.hands, worlds.holes, worlds.plates, worlds.objects):
    data_app.command(command.__name__)(command)

train_app.command("hands")(hand_commands.train)
eval_app.command("hands")(hand_commands.evaluate)
for name, commands in (("semantic", semantic_commands), ("grasp", grasp_commands)):
    train_app.command(name)(commands.train)
    eval_app.command(name)(commands.evaluate)
