"""A small sweep on Dask: all runs are there though a worker is killed, as they are one by one, and none twice."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_product, simulated
from bracket_cell.fleet.one_run import _sent, run_here
from bracket_cell.fleet.packing import MOST_SENT_BYTES
from bracket_cell.fleet.spec import Seeds, Sweep, apart, count, load_sweep, tasks
from bracket_cell.fleet.table import read_table
from bracket_cell.fleet.task import Task
from bracket_ground.errors import InputError
from bracket_ground.interfaces.robot import FOLDER
from tests.arms import NEARER, cell_file, robot_file

WALL = ("peak", "wall", "took", "cpu", "real_time", "overruns", "late", "log", "contact_sheet")
WORKER = re.compile(r"spawn_main|one_run import serve")
LEAF = "from btxml import Node, Status\n\nclass Settles(Node):\n    def update(self):\n        return Status.SUCCESS\n"
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Settles/></BehaviorTree></root>'
SPEC = "seeds: {first: 3, count: 3}\nmax_duration_s: 0.3\ngoals: [g0, g1]\n"


def decided(row: dict[str, Any]) -> dict[str, Any]:
    """What of a row does not hang on the machine, as the table holds it: there an empty text is no value."""
    return {
        name: json.dumps(value) if isinstance(value, dict | list) else value
        for name, value in row.items()
        if not name.startswith(WALL) and value not in (None, "")
    }


def workers(of: int) -> list[psutil.Process]:
    """Processes of a sweep that run tasks, found by what they were started as."""
    return [child for child in psutil.Process(of).children(recursive=True) if WORKER.search(" ".join(child.cmdline()))]


@pytest.mark.slow
def test_a_sweep_whose_worker_is_killed_has_all_runs(tmp_path: Path) -> None:
    spec, out = tmp_path / "spec.yaml", tmp_path / "out"
    spec.write_text(SPEC)
    command = [
        sys.executable,
        "-m",
        "bracket_cell",
        "lab",
        "sweep",
        str(spec),
        "--out",
        str(out),
        "--workers",
        "1",
        "--json",
    ]
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "env": {**os.environ, "TMPDIR": str(scratch)}}
    with subprocess.Popen(command, text=True, **told) as running:  # type: ignore[call-overload]
        journal = out / "runs.jsonl"
        while running.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n")):
            time.sleep(0.05)
        for victim in workers(running.pid):
            try:
                os.kill(victim.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        answer, _ = running.communicate()
    assert running.returncode == 0, answer
    assert not list(scratch.iterdir()), "something of the killed workers is left"
    rows = read_table(out / "runs.parquet")
    alone = [run_here(task) for task in tasks(load_sweep(spec))]
    assert [row["key"] for row in rows] == [row["key"] for row in alone]
    assert [decided(row) for row in rows] == [decided(row) for row in alone]
    before = (out / "runs.jsonl").read_bytes()
    done = subprocess.run(command, capture_output=True, check=False)  # goes on where it stopped: nothing is left
    assert (done.returncode, (out / "runs.jsonl").read_bytes()) == (0, before)


@pytest.mark.long
def test_rows_of_another_sweep_in_its_folder_are_told(tmp_path: Path) -> None:
    """What a changed file or program leaves out of the table is no silent new beginning."""
    spec, out = tmp_path / "spec.yaml", tmp_path / "out"
    command = [sys.executable, "-m", "bracket_cell", "lab", "sweep", str(spec), "--out", str(out), "--workers", "1"]
    said = []
    for longest_s in (0.2, 0.3):
        spec.write_text(f"seeds: {{first: 3, count: 2}}\nmax_duration_s: {longest_s}\npixels: false\n")
        said.append(" ".join(subprocess.run(command, capture_output=True, text=True, check=True).stderr.split()))
    assert "not in the table" not in said[0]
    assert re.search(r"2 rows of \S+ not in the table: other files, settings or versions", said[1])


def test_every_combination_is_a_task_of_its_own() -> None:
    sweep = Sweep(seeds=Seeds(count=2), people=("careful", "careless"), goals=("g0", "random"), faults=(None,))
    found = list(tasks(sweep))
    assert len({task.key for task in found}) == len(found) == count(sweep) == 8
    assert [task.seed for task in found] == [0] * 4 + [1] * 4
    names = {name for name, _ in found[0].packed.files}
    assert {
        "trees/assemble.xml",
        "trees/clear_and_grasp.xml",
        "config/cell.yaml",
        "config/products.yaml",
        "config/sim.yaml",
    } <= names


def test_trees_of_one_name_are_told_apart_and_are_runs_of_their_own(tmp_path: Path) -> None:
    trees = []
    for name in ("a", "b"):
        shutil.copytree(DEFAULT_CONFIGURATION.parent.parent / "trees", tmp_path / name, ignore=lambda *_: {"nodes"})
        trees.append(tmp_path / name / "assemble.xml")
    trees[1].write_text(trees[1].read_text().replace("<StartGraph", '<Sleep msec="1"/><StartGraph', 1))
    assert list(apart(trees).values()) == ["a/assemble.xml", "b/assemble.xml"]
    one, other = tasks(Sweep(trees=tuple(trees)))
    assert (dict(one.label)["tree"], dict(other.label)["tree"]) == ("a/assemble.xml", "b/assemble.xml")
    assert one.key != other.key


def test_an_arm_of_ones_own_travels_with_a_run_with_urdf_and_meshes(tmp_path: Path) -> None:
    (tmp_path / "cell").mkdir()
    urdf = robot_file(tmp_path / "cell", "seven").with_suffix(".urdf")
    shutil.copy(FOLDER / "ur10" / "collision" / "wrist3.stl", tmp_path / "cell" / "own.stl")
    shape = '<collision><geometry><mesh filename="own.stl"/></geometry></collision></link><joint name="ax3"'
    urdf.write_text(urdf.read_text().replace('</link><joint name="ax3"', shape, 1))
    config = cell_file(tmp_path / "cell", "seven.yaml", {**NEARER, "max_duration_s: 300.0": "max_duration_s: 1.0"})
    [task] = tasks(Sweep(configurations=(config,), pixels=False))
    shutil.rmtree(tmp_path / "cell")  # a worker has none of it
    assert run_here(task)["end"] == "timeout"


def test_weights_and_nodes_travel_with_a_run_and_are_in_its_key(tmp_path: Path) -> None:
    shutil.copytree(DEFAULT_CONFIGURATION.parent, tmp_path / "config")
    (tmp_path / "own").mkdir()
    shipped = DEFAULT_CONFIGURATION.parent.parent / "learned" / "weights" / "grasp_pairwise.onnx"
    weights = tmp_path / "own" / "grasp.onnx"
    weights.write_bytes(shipped.read_bytes())
    configuration, nodes = tmp_path / "config" / DEFAULT_CONFIGURATION.name, tmp_path / "mine.py"
    text = configuration.read_text()
    configuration.write_text(text.replace("  grasp:\n", f"  grasp:\n    weights: {weights}\n", 1))
    nodes.write_text("")
    keys = []
    for content in (weights.read_bytes(), weights.read_bytes() + b"\0"):
        weights.write_bytes(content)
        [task] = tasks(Sweep(configurations=(configuration,)), None, [str(nodes)])
        sent = dict(task.packed.files)
        [name] = [one for one in sent if one.endswith("grasp.onnx")]
        assert sent[name] == content
        assert "../own/grasp.onnx" in sent[task.packed.configuration].decode()
        assert [Path(node).name for node in task.packed.nodes] == ["mine.py"]
        keys.append(task.key)
    assert keys[0] != keys[1]
    weights.write_bytes(bytes(MOST_SENT_BYTES + 1))
    with pytest.raises(InputError, match="legal: up to"):
        list(tasks(Sweep(configurations=(configuration,))))
    weights.unlink()
    with pytest.raises(InputError, match="which are not there"):
        list(tasks(Sweep(configurations=(configuration,))))


EXAMPLES = sorted((DEFAULT_CONFIGURATION.parent / "examples").glob("*/cell.yaml"))


@pytest.mark.parametrize("config", EXAMPLES, ids=lambda path: path.parent.name)
def test_what_a_configuration_names_travels_with_a_run(config: Path, tmp_path: Path) -> None:
    """Grippers, meshes, products in other folders: a worker has nothing but the package."""
    [task] = tasks(Sweep(configurations=(config,)))
    there = unpacked(task, tmp_path)
    configuration = load_configuration(there)
    assert load_product(configuration, there) == load_product(load_configuration(config), config)
    assert configuration.robot.gripper == load_configuration(config).robot.gripper


def test_files_anywhere_and_nodes_of_a_configuration_travel_with_a_run(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    for name in ("cell.yaml", "products.yaml", "sim.yaml"):
        shutil.copy(DEFAULT_CONFIGURATION.parent / name, tmp_path / name)
    product = (tmp_path / "products.yaml").rename(tmp_path / "mine" / "product.yaml")
    (tmp_path / "mine" / "leaves.py").write_text(LEAF)
    text = (tmp_path / "cell.yaml").read_text()
    text = text.replace("product: products.yaml", f"nodes: [mine]\nproduct: {product}", 1)
    (tmp_path / "cell.yaml").write_text(text)
    tree = tmp_path / "mine" / "tree.xml"
    tree.write_text(TREE)
    spec = tmp_path / "spec.yaml"
    spec.write_text("trees: [mine/tree.xml]\nconfigurations: [cell.yaml]\nmax_duration_s: 1\npixels: false\n")
    [task] = tasks(load_sweep(spec))
    shutil.rmtree(tmp_path / "mine")  # a worker has none of it
    row = run_here(task)
    assert (row["end"], row["reason"]) == ("finished", "the tree succeeded")


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("people: [careful, nobody]", "spec.yaml:1:19: no person and no file 'nobody'"),
        ("looks: [dark]", "spec.yaml:1:9: no look 'dark'"),
        ("goals: [g0, g9]", "spec.yaml:1:13: unknown goal 'g9'; legal: g0"),
        ("faults: [null, arm_frozen@fly]", "spec.yaml:1:16: unknown state 'fly'"),
        ("faults: [arm.positions_rad.6:offset@carry]", "spec.yaml:1:10: .*the arm has joints 0 to 5"),
        ("trees: []", "spec.yaml:1:8: trees"),
    ],
)
def test_what_cannot_be_run_is_refused_with_its_line(text: str, refused: str, tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_text(text)
    with pytest.raises(InputError, match=refused):
        list(tasks(load_sweep(tmp_path / "spec.yaml"), spec=tmp_path / "spec.yaml"))


def test_people_are_files_beside_the_sweep_and_come_back_to_no_file(tmp_path: Path) -> None:
    (tmp_path / "me.yaml").write_text("pace: [2, 2]\n")
    spec = tmp_path / "spec.yaml"
    spec.write_text("people: [me.yaml, 'seated,me.yaml', careful]\n")
    found = list(tasks(load_sweep(spec)))
    assert [dict(task.label)["person"] for task in found] == ["me.yaml", "seated,me.yaml", "careful"]
    for task in found:
        assert all(Path(name).parts[0] in ("config", "people", "trees") for name, _ in task.packed.files)
        there = unpacked(task, tmp_path / task.key)
        people = _sent(there.parent.parent, task.person)
        simulation: Any = simulated(load_configuration(), None, people).devices.simulation
        paces = [person.pace for person in simulation.people]
        assert paces in ([], [(0.6, 0.8), (2.0, 2.0)])
    (tmp_path / "me.yaml").write_text("pace: [3, 3]\n")
    keys = [task.key for task in tasks(load_sweep(spec))]
    assert not {*keys} & {task.key for task in found}


def unpacked(task: Task, folder: Path) -> Path:
    """The configuration of a task among its files, as a worker writes them."""
    for name, content in task.packed.files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder / task.packed.configuration


def _ended(summary: dict[str, Any]) -> Any:
    def run(options: Any, _: Any) -> SimpleNamespace:
        options.log.write_bytes(b"a log")
        return SimpleNamespace(summary={**summary, "log": str(options.log)})

    return run


@pytest.mark.parametrize(
    ("summary", "all_kept"),
    [
        ({"end": "finished", "correct": True}, False),
        ({"end": "finished", "correct": None}, False),
        ({"end": "finished", "correct": False}, True),
        ({"end": "failed", "correct": None}, True),
    ],
)
def test_logs_of_failures_and_of_a_sample_are_kept(
    summary: dict[str, Any], all_kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice the same sample: it follows from what a run is made of."""
    monkeypatch.setattr("bracket_cell.runs.run.run", _ended(summary))
    names = []
    for again in ("first", "again"):
        logs = tmp_path / again
        asked = list(tasks(Sweep(seeds=Seeds(count=20)), str(logs), keep_one_in=20))
        logs.mkdir()
        rows = [run_here(task) for task in asked]
        names.append(sorted(file.name for file in logs.iterdir()))
        assert [Path(row["log"]).name for row in rows if row.get("log")] == [
            f"{task.key}.mcap" for task in asked if task.keeps(summary)
        ]
    assert names[0] == names[1]
    assert len(names[0]) == 20 if all_kept else len(names[0]) < 10  # of 20 with a chance of .05 each
