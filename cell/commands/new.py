"""`cell new`: a tree file or a leaf in the working folder, each with a test that passes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.terminal import console
from cell.errors import InputError
from cell.files.files import write_new

new_app = typer.Typer(no_args_is_help=True, help="Start a tree file or a node of your own, with its test.")

NameArgument = Annotated[str, typer.Argument(help="Name in tree files, like CountParts.")]

TREE = """<root BTCPP_format="4" main_tree_to_execute="{name}">
  <BehaviorTree ID="{name}">
    <Sequence>
      <ActivateGripper/>
      <MoveTo pose="park"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
TREE_TEST = '''"""Tests of trees/{file}.xml without the cell."""

from trees import Bench


def test_nothing_moves_while_the_gripper_is_not_active() -> None:
    # S: success, F: failure, R: running, one letter a tick
    bench = Bench("trees/{file}.xml", {{"ActivateGripper": "RF"}})
    assert [bench.tick(), bench.tick()] == ["R", "F"]
    assert bench.started("MoveTo") == 0
'''
LEAF = '''"""The node {name}."""

from trees import InputPort, Node, OutputPort, Status


class {name}(Node):
    """Say in one line what it does; `cell nodes` prints that."""

    least = InputPort(int, "fails below this number", default=1)
    count = OutputPort(int, "how many there are")

    def update(self) -> Status:
        self.count.set(0)
        self.feedback_message = "nothing is counted yet"
        return Status.FAILURE if self.least.get() > 0 else Status.SUCCESS
'''
LEAF_TEST = '''"""Tests of the node {name} alone."""

from trees import Status
from trees.node_library import node_registry
from trees.testing import alone


def test_too_few_fail() -> None:
    node = alone(node_registry(more=["nodes"]).classes["{name}"]("count"), least=1)
    assert node.execute() is Status.FAILURE
    assert node.feedback_message == "nothing is counted yet"
'''


@new_app.command()
def tree(name: NameArgument) -> None:
    """Write trees/NAME.xml and tests/test_NAME.py."""
    _write(name, "trees/{file}.xml", TREE, TREE_TEST, "cell check {first}; pytest {second}")


@new_app.command()
def leaf(name: NameArgument) -> None:
    """Write nodes/NAME.py and tests/test_NAME.py."""
    then = "pytest {second}; `nodes: [nodes]` in the configuration, or --with nodes, makes it known to every command"
    _write(name, "nodes/{file}.py", LEAF, LEAF_TEST, then)


def _write(name: str, path: str, text: str, test: str, then: str) -> None:
    if not re.fullmatch(r"[A-Z][A-Za-z0-9]{0,60}", name):
        raise InputError(
            f"'{name}' cannot name a node or tree; use letters and digits with a capital first, like CountParts"
        )
    file = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
    files = {path.format(file=file): text, f"tests/test_{file}.py": test}
    write_new(Path(), {place: content.format(name=name, file=file).encode() for place, content in files.items()})
    first, second = files
    console().print(f"{first}\n{second}\nnext: {then.format(first=first, second=second)}", highlight=False)
