"""Every problem of a YAML file is reported at once, with its line and column."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import Field

from bracket_cell.configuration import DEFAULT_CONFIGURATION, Configuration, load_configuration, load_product
from bracket_cell.kinds import files_of
from bracket_ground.errors import InputError, Problem
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.product import Product

PRODUCT = DEFAULT_CONFIGURATION.with_name("products.yaml")


class Leaf(Model):
    """A model below a model."""

    speed_m_s: float
    count: int = 3


class Branch(Model):
    """Everything that locations can lead through."""

    leaf: Leaf
    by_name: dict[str, Leaf] = Field(default_factory=dict)
    listed: tuple[Leaf, ...] = ()
    maybe: Leaf | None = None
    folder: Path = Path()


def problems(tmp_path: Path, text: str, model: type[Model] = Branch) -> list[str]:
    """Line, column and words of all problems that a file has."""
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_yaml(path, model)
    found = [problem for problem in caught.value.problems if isinstance(problem, Problem)]
    assert len(found) == len(caught.value.problems)
    assert all(problem.place.file == path for problem in found)
    return [str(problem).removeprefix(f"{path}:") for problem in found]


def test_a_good_file_becomes_its_model(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    path.write_text("leaf: {speed_m_s: 2}\nlisted: [{speed_m_s: 1.5, count: 4}]\nmaybe:\n")
    expected = Branch(leaf=Leaf(speed_m_s=2.0), listed=(Leaf(speed_m_s=1.5, count=4),), maybe=None)
    assert load_yaml(path, Branch) == expected


def test_all_problems_are_found_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = "leaf:\n  speed_ms: 1.0\nby_name:\n  left: {speed_m_s: fast}\nlisted:\n  - speed_m_s: 1.0\n    count: many\n"
    found = problems(tmp_path, text)
    assert [one.split(" ")[0] for one in found] == ["1:1:", "2:3:", "4:21:", "7:12:"]
    assert found[0].endswith("key 'speed_m_s' is missing")
    assert "unknown key 'speed_ms'; did you mean 'speed_m_s'? legal here: speed_m_s, count" in found[1]
    assert "by_name.left.speed_m_s" in found[2]
    assert "'fast'" in found[2]
    assert "listed.0.count" in found[3]


def test_legal_keys_are_named_below_dicts_lists_and_options(tmp_path: Path) -> None:
    text = (
        "leaf: {speed_m_s: 1}\nby_name: {a: {speed_m_s: 1, b: 1}}\n"
        "listed: [{speed_m_s: 1, c: 1}]\nmaybe: {speed_m_s: 1, d: 1}\n"
    )
    found = problems(tmp_path, text)
    assert [one[0] for one in found] == ["2", "3", "4"]
    assert all("legal here: speed_m_s, count" in one for one in found)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("leaf:\n  speed_m_s: 1\n  speed_m_s: 2\n", "3:3: key 'speed_m_s' appears twice; first in line 2"),
        ("leaf: [1, 2\n", "2:1: not YAML: expected ',' or ']', but got"),
        ("\n", "1:1: the file is empty"),
        ("leaf: &a\n  b: *a\n", "1:7: an alias that contains itself"),
        ("- 1\n", "1:1: the file: input should be"),
        ("leaf: !!python/object:os.system run\n", "1:7: not YAML: could not determine a constructor"),
        ("leaf: !!int three\n", "1:7: 'three' cannot be read as int"),
        (f"leaf: {'9' * 5000}\n", f"1:7: '{'9' * 40}...' cannot be read as int"),
        (f"leaf: {'[' * 50_000}{']' * 50_000}\n", "1: nested more than 64 levels deep"),
        (f"{'- ' * 50_000}x\n", "1: nested more than 64 levels deep"),
    ],
)
def test_what_is_no_mapping_of_plain_data_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    assert problems(tmp_path, text)[0].startswith(expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("leaf: 3\n", "1:7: leaf: input should be keys with values, not 3; legal here: speed_m_s, count"),
        ("leaf: [1]\n", "1:7: leaf: input should be keys with values, not a list; legal here: speed_m_s, count"),
        ("leaf: {speed_m_s: 1}\nby_name: x\n", "2:10: by_name: input should be keys with values, not 'x'"),
        ("leaf: {speed_m_s: 1}\nlisted: 4\n", "2:9: listed: input should be a list, not 4"),
        ("leaf: {speed_m_s: 1}\nfolder: 4\n", "2:9: folder: input should be a path, not 4"),
        ("leaf: {speed_m_s: {a: 1}}\n", "1:19: leaf.speed_m_s: input should be a number, not keys with values"),
        ("leaf: {speed_m_s: x}\n", "1:19: leaf.speed_m_s: input should be a number, not 'x'"),
        ("leaf: {speed_m_s: 1, count: 1.5}\n", "1:29: leaf.count: input should be a whole number, not 1.5"),
    ],
)
def test_another_kind_of_value_is_told_in_the_words_of_yaml(tmp_path: Path, text: str, expected: str) -> None:
    assert problems(tmp_path, text) == [expected]


def test_aliases_of_aliases_make_no_more_than_anybody_goes_through(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x]", *(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 60))]
    assert problems(tmp_path, "\n".join(lines)) == ["19:6: aliases make more than 1,000,000 values of it"]


def test_a_file_that_is_not_there_or_not_text_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read: No such file"):
        load_yaml(tmp_path / "none.yaml", Branch)
    (tmp_path / "bytes.yaml").write_bytes(b"leaf: \xff\xfe")
    with pytest.raises(InputError, match=r"bytes\.yaml: is not UTF-8 text"):
        load_yaml(tmp_path / "bytes.yaml", Branch)


def test_goals_that_disagree_with_quantities_are_named_by_line(tmp_path: Path) -> None:
    lines = PRODUCT.read_text().splitlines()
    row = next(i for i, line in enumerate(lines) if line.strip().startswith("g1:"))
    lines[row] = lines[row].replace("o3", "o1")
    [found] = problems(tmp_path, "\n".join(lines), Product)
    assert found.startswith(f"{row + 1}:7: goal g1 needs 4 x o1, but the quantities are 3 x o1")


def test_the_shipped_configuration_and_product_load() -> None:
    configuration = load_configuration()
    product = load_product(configuration)
    assert product.positions == ("p1", "p2", "p3", "p4", "p5", "p6")
    assert configuration.product.is_absolute()
    for use, planner in configuration.planners:
        files = files_of(use, planner)
        assert files
        assert all(file.is_absolute() and file.is_file() for file in files.values())


def test_a_product_that_the_bench_has_no_bins_for_names_the_bench(tmp_path: Path) -> None:
    (tmp_path / "products.yaml").write_text(PRODUCT.read_text())
    (tmp_path / "sim.yaml").write_text("{}")
    path = tmp_path / "cell.yaml"
    path.write_text(DEFAULT_CONFIGURATION.read_text().replace("    o2: [", "    o7: ["))
    with pytest.raises(InputError, match=r"cell\.yaml:\d+:\d+: no bin for part type 'o2'"):
        load_product(load_configuration(path), path)


def test_every_section_of_the_configuration_refuses_unknown_keys(tmp_path: Path) -> None:
    text = DEFAULT_CONFIGURATION.read_text()
    for section in ("bench", "controller", "perception", "planners", "guard", "devices", "log"):
        changed = text.replace(f"\n{section}:", f"\n{section}:\n  surprise: 1\n#", 1)
        lines = changed.splitlines()
        line = lines.index("  surprise: 1")
        # The rest of the line with the section's name became a comment line of its own.
        found = problems(tmp_path, "\n".join(lines), Configuration)
        assert any(one.startswith(f"{line + 1}:3: unknown key 'surprise'") for one in found), (section, found)
