"""The bill of materials holds every pin, and all that comes with the program, with licences."""

from __future__ import annotations

import json
import re
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from cyclonedx.validation.json import JsonStrictValidator

from tests import ROOT
from tests.docs.sbom import FONTS, MESHES_LICENCE, THREE, VERSION, bill, written

FOREIGN = {".onnx", ".stl", ".obj", ".dae", ".urdf", ".ttf", ".otf", ".woff", ".woff2"}  # a file that needs a licence
PACKAGES = ("ground", "engine", "cell", "sim", "lab")


@cache
def text() -> str:
    return written(bill())


def components() -> dict[str, Any]:
    return {component["name"]: component for component in json.loads(text())["components"]}


def licence(component: dict[str, Any]) -> str:
    return str(component["licenses"][0]["license"]["id"])


def test_it_is_valid_cyclonedx() -> None:
    assert JsonStrictValidator(VERSION).validate_str(text()) is None


def test_every_pin_is_in_it() -> None:
    pins = [line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line]
    found = components()
    assert len(pins) > 200
    assert [name for name, version in pins if found[name]["purl"] != f"pkg:pypi/{name}@{version}"] == []


def test_every_shipped_file_that_needs_a_licence_is_in_it_as_it_is() -> None:
    found = components()
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.suffix in FOREIGN]
    assert {path.suffix for path in files} >= {".onnx", ".stl", ".urdf"}
    for path in (THREE, *files):
        component = found[str(path.relative_to(ROOT))]
        assert component["hashes"] == [{"alg": "SHA-256", "content": sha256(path.read_bytes()).hexdigest()}]
        assert licence(component)


def test_licences_are_those_of_the_files_beside() -> None:
    found = components()
    beside: dict[Path, tuple[str, str]] = {
        ROOT / "cell/bracket_cell/config/robots/ur10/ur10.urdf": (MESHES_LICENCE, "BSD 3-Clause"),
        THREE: ("MIT", "The MIT License"),
    }
    for path, (identifier, words) in beside.items():
        assert words in (path.parent / "LICENSE").read_text()
        assert licence(found[str(path.relative_to(ROOT))]) == identifier


def test_the_fonts_that_the_program_asks_the_system_for_are_in_it() -> None:
    fonts = re.findall(r"\bfonts-[\w-]+", (ROOT / "Makefile").read_text())
    assert fonts == [FONTS[0]]
    assert licence(components()[fonts[0]]) == FONTS[1]
