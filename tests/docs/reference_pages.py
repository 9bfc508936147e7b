"""docs/reference/: pages that the code itself writes: faults, topics of a log, attributes of nodes and ports."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from bracket_cell.configuration import load_configuration, load_faults
from bracket_cell.recording.schemas import TOPICS, schema
from bracket_cell.trees import vocabulary
from bracket_cell.viewing.advice import ADVICE, ENDS
from bracket_ground.files.words.catalogue import catalogue
from bracket_ground.interfaces.faults import SIGNALS as SIGNS
from bracket_ground.interfaces.faults import FaultTable
from bracket_sim.faults.named_faults import FAULTS as PUT
from bracket_sim.faults.named_faults import FaultKind
from bracket_sim.faults.signal_faults import DETECTED, SIGNALS, Spread
from btxml.engine.node import Control, Decorator, Node, TreeNode
from btxml.engine.ports import InOutPort, InputPort, OutputPort, Port
from btxml.engine.traits import Traits

NAMES = r"^    ([a-z_]+(?:, [a-z_]+)*): "
ATTRIBUTE = re.compile(rf"{NAMES}(.*?)(?={NAMES}|\Z)", re.MULTILINE | re.DOTALL)
MADE = "`make pictures` writes this page from the code."

FAULTS = f"""# The table of faults

{MADE} The table itself is `config/faults.yaml`.
[safety.md](../safety.md) explains the actions.

- `sense is alive by`: what proves, in a sound cell, that the sense behind a sign works.
- `after s`: how long a sign must be seen.
- `gone s`: how long it must be gone.
- `stops after s`: a hold or slow that lasts longer becomes a stop.
- `clears`: by `itself` when it has gone; at `standstill` of the arm; when a `person` gives the order *acknowledge*;
  `never`.

"""
SAID = """
# What the page says

Of the first cause, in a line, and in German:

| sign, or end of a run | what a person does | |
|---|---|---|
"""
PUT_IN = """
# Faults to put in

`--inject` and `cell lab eval faults` take these by name:

| fault | what | a run ends | signals |
|---|---|---|---|
"""
MISHAPS = """
And these, with a part on a simulated bench. What is let go is never in the air, and a bracket that is called finished
is right.

| fault | what | comes in | what the cell does | a run ends |
|---|---|---|---|---|
"""
BY_SIGNAL = """
And any DEVICE.SIGNAL[.JOINT]:KIND[:SIZE], with a joint from 0 on and a size in the signal's unit, as a factor, in
seconds, or as the value that another device tells. `cut` is a part of the value, `refused` an exception. `--drawn`
draws the kinds of this table:

| signal | kinds | offset |
|---|---|---|
"""
LOG_TOPICS = f"""# Topics of a log

{MADE} [logs.md](../logs.md) is the guide. A field that is None is
left out, and messages may hold more than these fields. A number that is not finite is the text `inf`, `-inf` or `nan`:
JSON has none. Further topics:

- `/camera/overhead`, `/camera/wrist`: JPEG images. `/depth/overhead`: PNG images of 16 bits, in millimetres, 0 for
  unknown.
- `/joint_samples`: what the arm measured between two ticks, in protobuf. It has the time, and for each joint position,
  velocity and effort.
- `/log`: lines of text.
- `/joint_states`, `/tf/*`, `/scene/*`, `/camera/*/calibration`, `hand`, `holes`, `parts`: for viewers. Nothing is
  replayed from them.

`/truth` exists in simulation only, and nothing in the cell reads it.

| topic | fields |
|---|---|
"""
NODES = f"""# Nodes in Python

{MADE} [leaves.md](../leaves.md) is the guide, with examples.

"""


def faults() -> str:
    """The table that the supervisor follows unless a configuration names another."""
    named = (
        f"| {name} | {kind.what} | {_ends(kind)} | {_codes(kind.signals)} |\n"
        for name, kind in PUT.items()
        if not kind.of_world
    )
    mishaps = (
        f"| {name} | {kind.what} | {', '.join(kind.states)} | {kind.promise} | {_ends(kind)} |\n"
        for name, kind in PUT.items()
        if kind.of_world
    )
    drawn = (
        f"| `{name}` | {', '.join(signal.kinds)} | {_offset(signal)} |\n"
        for name, signal in (SIGNALS | DETECTED).items()
    )
    table = fault_table_markdown(load_faults(load_configuration()))
    german = catalogue("de").texts
    ends = {f"the run ended: {end or 'its program is gone'}": words for end, words in ENDS.items()}
    said = (f"| `{name}` | {words} | {german[words]} |\n" for name, words in {**ADVICE, **ends}.items())
    return (
        FAULTS
        + table
        + SAID
        + "".join(said)
        + PUT_IN
        + "".join(named)
        + MISHAPS
        + "".join(mishaps)
        + BY_SIGNAL
        + "".join(drawn)
    )


def _ends(kind: FaultKind) -> str:
    """How a run may end with a fault."""
    held = f"; with a part in the fingers: {' or '.join(kind.holding_ends)}" if kind.holding_ends else ""
    unseen = f"; finished in {', '.join(kind.unseen_in)}: nothing moves that shows it" if kind.unseen_in else ""
    return " or ".join(kind.ends) + held + unseen


def log_topics() -> str:
    """Every topic whose messages are JSON, with its fields."""
    rows = (f"| `{topic}` | {', '.join(f'`{name}`' for name in schema(topic)['properties'])} |" for topic in TOPICS)
    return LOG_TOPICS + "\n".join(rows) + "\n"


def nodes() -> str:
    """What a class of a node or port may say, from the docstrings."""
    words = [member for _, member in inspect.getmembers(vocabulary, inspect.isclass)]
    own = [word for word in words if word.__module__ == vocabulary.__name__]
    lines = [
        "## Leaves", *_text(Node), "",
        "## Attributes of every node", *_table(TreeNode), "",
        "## Traits: what the checker may rely on", *_text(Traits), "", *_table(Traits), "",
        "## Controls and decorators", *_list((Control, Decorator)), "",
        "## Ports", *_list((InputPort, OutputPort, InOutPort)), "",
        *_table(Port), "",
        "A node reads an input with `unset_ok` by `get_or(other)`. `cell check` refuses a tree in which no node can",
        "have written another input.", "",
        "## Names as types of ports",
        f"`{vocabulary.__name__}` has these types; the configuration says which names are legal.", "", *_list(own), "",
        "Tree files can write values of a class of your own if it has a classmethod `from_text(text)`, which raises",
        "ValueError, and an attribute `like` that shows how its texts look.",
    ]  # fmt: skip
    return NODES + "\n".join(lines) + "\n"


PAGES: dict[str, Callable[[], str]] = {
    "docs/reference/faults.md": faults,
    "docs/reference/log-topics.md": log_topics,
    "docs/reference/nodes-in-python.md": nodes,
}


def _codes(words: Iterable[str]) -> str:
    return ", ".join(f"`{word}`" for word in words)


def _offset(spread: Spread) -> str:
    return f"{spread.offset:g}" if "offset" in spread.kinds else ""


def _doc(thing: Any) -> str:
    return inspect.cleandoc(thing.__doc__)


def _text(kind: type) -> Iterator[str]:
    """A docstring without its attributes."""
    yield from _doc(kind).partition("\nAttributes:\n")[0].rstrip().splitlines()


def _table(kind: type) -> Iterator[str]:
    yield "| attribute | meaning |"
    yield "|---|---|"
    for names, meaning, _ in ATTRIBUTE.findall(_doc(kind).partition("\nAttributes:\n")[2]):
        yield f"| {', '.join(f'`{name}`' for name in names.split(', '))} | {' '.join(meaning.split())} |"


def _list(things: Any) -> Iterator[str]:
    for thing in things:
        yield f"- `{thing.__name__}`: {_doc(thing).splitlines()[0]}"


def fault_table_markdown(table: FaultTable) -> str:
    """The table for docs/safety.md."""
    rows = [
        "| signal | seen when | sense is alive by | action | clears | after s | gone s | stops after s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for fault in table.faults:
        sign = SIGNS[fault.signal]
        action = f"{fault.action} to {fault.share:.0%}" if fault.share < 1 else fault.action
        stops = "" if fault.stop_after_s is None else f"{fault.stop_after_s:g}"
        cells = (fault.signal, *sign, action, fault.clear, f"{fault.delay_s:g}", f"{fault.clear_s:g}", stops)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"
