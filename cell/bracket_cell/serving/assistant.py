"""What an assistant that writes trees is offered, by the Model Context Protocol: the commands of the cell as tools."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bracket_cell.configuration import load_configuration
from bracket_cell.packages import needed

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

LIMIT_S = 900.0  # a command takes no longer
ANSWER_MOST = 60_000  # letters
REFUSED = 2  # status of input that is refused
INSTRUCTIONS = """Behaviour trees of an assembly cell, in the folder that this server was started in. Read the guide
`authoring` first. Write trees with your own file tools; then `check`, then `simulate` with several seeds, then `why`
about a log that failed. Nothing here moves a real robot or changes a file, but for the logs of simulations."""


def assistant_server() -> MCPServer:
    """A server with a tool for each command; it serves over standard input and output.

    Raises:
        InputError: the extra is not installed.
    """
    library = needed("mcp.server.mcpserver", "--assistant", "assistant")
    server: MCPServer = library.MCPServer("cell", instructions=INSTRUCTIONS)
    for tool in (nodes, check, simulate, why, logs, compare_logs, guide):
        server.tool()(tool)
    return server


def nodes(name: str = "") -> str:
    """List the nodes that tree files may name, or one with its ports."""
    return _answer("nodes", *_named(name))


def check(tree: str) -> str:
    """Say everything that is wrong with a tree file, as JSON: problems with line, column and cure."""
    return _answer("check", "--json", "--", tree)


def simulate(tree: str, seed: int, goal: str = "random", config: str = "config/cell.yaml") -> str:
    """Run a tree in simulation without rendering; the same seed gives the same run. The answer names the log.

    Refused where a device of the configuration is real.
    """
    devices = load_configuration(Path(config)).devices
    real = [name for name in type(devices).model_fields if getattr(getattr(devices, name), "kind", "sim") != "sim"]
    if not devices.simulated or real:
        return f"status {REFUSED}\n{config} has real devices; only a simulated cell is run from here: {', '.join(real)}"
    words = (f"--config={config}", f"--seed={seed}", f"--goal={goal}", "--look=none", "--json", "--", tree)
    return _answer("run", *words)


def why(log: str) -> str:
    """Say why the tree of a log ended as it did, and what would have changed it."""
    return _answer("log", "why", "--json", "--", log)


def logs(folder: str = "runs") -> str:
    """List the logs of a folder, newest last."""
    files = [log for log in Path(folder).glob("*.mcap") if log.is_file()]
    return "\n".join(map(str, sorted(files, key=lambda log: log.stat().st_mtime)))


def compare_logs(first: str, second: str) -> str:
    """Say where the decisions of two logs part."""
    return _answer("log", "diff", "--json", "--", first, second)


def guide(page: str = "") -> str:
    """Read a guide, or list all by their titles."""
    return _answer("docs", *_named(page))


def _named(name: str) -> list[str]:
    return ["--", name] if name else []


def _answer(*words: str) -> str:
    """Status and output of a command; of a command that fails, its message."""
    command = [sys.executable, "-m", "bracket_cell", *words]
    nothing = subprocess.DEVNULL
    done = subprocess.run(command, stdin=nothing, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    output = done.stdout if done.stdout.strip() else done.stderr
    return f"status {done.returncode}\n{output[-ANSWER_MOST:]}"
