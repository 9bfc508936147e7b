"""How many random trees run here as in BehaviorTree.CPP, and each listed difference tried; writes the page of both.

    python -m tests.trees.engine.agreement --seeds 20000:22000 [--modes kinds ports]

Modes that are not run keep their counts. Version 4.10 is the judge (`make judge`), 4.8 the package behaviortree_py.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import yaml

from tests import ROOT
from tests.trees.engine.differential import Judge, Original, Side, judged, standard_output
from tests.trees.engine.random_trees import Case, Features, Generator, named

HERE = Path(__file__).parent
COUNTS, DIFFERENCES = HERE / "agreement.json", HERE / "differences.yaml"
PAGE = ROOT / "docs" / "reference" / "conformance.md"
PROGRAM = ROOT / "build" / "judge"
MODES = {
    "plain": Features(),
    "scripts": Features(scripts=True),
    "skips": Features(skips=True),
    "skips and scripts": Features(skips=True, scripts=True),
    "data": Features(scripts=True, data=True),
    "everything": Features(skips=True, scripts=True, data=True),
    "kinds": Features(scripts=True, kinds=True),
    "kinds and skips": Features(skips=True, scripts=True, kinds=True),
    "ports": Features(scripts=True, ports=True),
    "typed": Features(scripts=True, typed=True),
}
JUDGED_ALONE = ("typed",)  # leaves of the judge's own
IN_ORDER = ("plain", "scripts")
SIZE = 40
VERSIONS = ("4.8", "4.10")
# How one side refuses what the other one takes, by the version beside; the page has a row for each.
LISTED: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("4.10", "refused here"): (
        *("takes {", "takes an int", "takes a bool", "which nothing writes", "is not an int", "is not a bool"),
    ),
    ("4.10", "refused there"): ("later type", "Invalid token '\"'"),
}
# Differences that the words of an end do not name, examined by hand: a write through `{@n}`, which has a row.
EXAMINED: Mapping[tuple[str, str], tuple[int, ...]] = {("4.10", "typed"): (20703, 21533)}
AGREED = ("equal", "raised there", "refused by both")
UNLISTED = "not listed"
WORDS = {
    "equal": "as here",
    "differs": "differs",
    "raised there": "raises",
    "refused there": "refuses",
    "refused here": "takes it",
    "refused by both": "refuses, too",
}
HEAD = """# The engine and BehaviorTree.CPP 4

Trees run here as in the library (4.8 and 4.10), but for these differences. What is stricter here, `cell check` tells.

`python -m tests.trees.engine.agreement --seeds 20000:22000` writes this page: it runs the tree of each difference
(`tests/trees/engine/differences.yaml`) and random trees beside both versions.

## Files from elsewhere

- `cell new tree NAME --convert FILE` turns a file of version 3 into one of version 4, and says what cannot be kept.
- Nav2's `RecoveryNode`, `RoundRobin`, `PipelineSequence`, `RateController` and `SpeedController` are here.
- MoveIt Pro's lists of poses and approvals are here: `cell nodes approv`.

## Differences

The last columns: what each version did with a tree that shows the difference; empty where no tree shows it.

| Here | There | 4.8 | 4.10 |
|---|---|---|---|
"""
RANDOM = """
## Random trees

A tree of up to 40 nodes, 20 ticks and some halts. After each, the leaves' starts, polls and halts, the status of every
node and the values of the blackboard are compared. *Raised*: equal until a script raised an exception there, which is a
failure here. *Listed*: by a row above. The second figure is the upper end of the 95 %
interval for trees that differ otherwise.

| mode | beside | trees | equal | raised | refused by both | listed | not listed | at most |
|---|---|---|---|---|---|---|---|---|
"""


@contextmanager
def library(version: str, judge: Judge | None) -> Iterator[Callable[[Case], Side]]:
    """Loads a case in a version; while it is open, standard output is the log of that case."""
    if judge is not None and version == VERSIONS[1]:
        yield judge.load
    else:
        with standard_output() as output:
            yield lambda case: Original(case, output)


def verdicts(version: str, mode: str, seeds: Iterable[int], judge: Judge | None) -> Iterator[tuple[str, str]]:
    """For each seed the kind of its end, `UNLISTED` for what the page does not explain, and words about it."""
    with TemporaryDirectory() as folder:
        for seed in seeds:
            case = Generator(seed, SIZE, MODES[mode]).case()
            with library(version, judge) as load:
                kind, found = judged(case, Path(folder) / "tree.xml", load, mode in IN_ORDER, version == VERSIONS[1])
            known = seed in EXAMINED.get((version, mode), ()) or any(
                word in found[0] for word in LISTED.get((version, kind), ())
            )
            yield (kind if kind in AGREED or known else UNLISTED), f"seed {seed}: {kind}: {found}\n{case}"


def counted(version: str, mode: str, seeds: range, judge: Judge | None) -> dict[str, int | str]:
    """How often each end came."""
    kinds: Counter[str] = Counter()
    problems = []
    for kind, words in verdicts(version, mode, seeds, judge):
        kinds[kind] += 1
        problems += [words] if kind == UNLISTED else []
    for words in problems:
        print(words)
    return {"seeds": f"{seeds.start}:{seeds.stop}", **dict(sorted(kinds.items()))}


@cache
def differences() -> list[dict[str, Any]]:
    """The rows of the page."""
    rows: list[dict[str, Any]] = yaml.safe_load(DIFFERENCES.read_text())
    return rows


def case_of(row: Mapping[str, Any]) -> Case:
    """The tree that shows a difference, eight ticks of it."""
    start = f'<RunOnce><Script code="{row["before"]}"/></RunOnce>' if "before" in row else ""
    trees = f'<BehaviorTree ID="Main"><Sequence>{start}{row["tree"]}</Sequence></BehaviorTree>'
    trees += f'<BehaviorTree ID="Other">{row["other"]}</BehaviorTree>' if "other" in row else ""
    root = ElementTree.fromstring(f'<root BTCPP_format="4" main_tree_to_execute="Main">{trees}</root>')
    named(root, 0)
    xml = ElementTree.tostring(root, encoding="unicode")
    return Case(xml, xml, row.get("answers", {}), frozenset(), 8)


def shown(row: Mapping[str, Any], version: str, judge: Judge | None) -> str:
    """What a version does with the tree of a difference."""
    typed = bool(row.get("typed"))
    if "tree" not in row or (typed and version != VERSIONS[1]):
        return ""
    with TemporaryDirectory() as folder, library(version, judge) as load:
        return WORDS[judged(case_of(row), Path(folder) / "tree.xml", load, False, typed)[0]]


def upper(differing: int, trees: int) -> str:
    """The end of Clopper and Pearson's interval."""
    from scipy.stats import beta

    return f"{100 * float(beta.ppf(0.975, differing + 1, trees - differing)):.2f} %"


def line(mode: str, version: str, counts: Mapping[str, int | str]) -> str:
    """A row of the table of random trees."""
    kinds = {kind: int(counts[kind]) for kind in counts if kind != "seeds"}
    trees, unlisted = sum(kinds.values()), kinds.get(UNLISTED, 0)
    listed = sum(kinds.get(kind, 0) for kind in ("refused here", "refused there", "differs"))
    cells = [mode, version, trees, *(kinds.get(kind, 0) for kind in AGREED), listed, unlisted, upper(unlisted, trees)]
    return f"| {' | '.join(map(str, cells))} |\n"


def page(data: Mapping[str, Any]) -> str:
    """The page, from what a run found."""
    rows = [
        f"| {' | '.join([row['here'], row['there'], *found]).replace('||', chr(92) + '|' + chr(92) + '|')} |\n"
        for row, found in zip(differences(), data["differences"], strict=True)
    ]
    lines = [line(mode, version, data["random"][mode][version]) for mode in MODES for version in data["random"][mode]]
    return HEAD + "".join(rows) + RANDOM + "".join(lines)


def stored() -> dict[str, Any]:
    """What the last run found."""
    data: dict[str, Any] = json.loads(COUNTS.read_text())
    return data


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", required=True)
    parser.add_argument("--modes", nargs="*", default=list(MODES), choices=list(MODES))
    given = parser.parse_args()
    seeds = range(*map(int, given.seeds.split(":")))
    judge = Judge(PROGRAM)
    data = stored()
    data["differences"] = [[shown(row, version, judge) for version in VERSIONS] for row in differences()]
    for mode in given.modes:
        for version in VERSIONS[1:] if mode in JUDGED_ALONE else VERSIONS:
            data["random"].setdefault(mode, {})[version] = counted(version, mode, seeds, judge)
            print(line(mode, version, data["random"][mode][version]), end="", flush=True)
            COUNTS.write_text(json.dumps(data, indent=1) + "\n")
    judge.end()
    PAGE.write_text(page(data))


if __name__ == "__main__":
    main()
