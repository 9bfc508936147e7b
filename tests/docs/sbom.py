"""Writes what the program is made of as CycloneDX 1.6: `make sbom`."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import DisjunctiveLicense
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from packageurl import PackageURL

from bracket_ground.files.files import write_whole
from bracket_lab.learned.training.cards import LICENCE
from tests import ROOT

VERSION = SchemaVersion.V1_6
CELL = ROOT / "cell" / "bracket_cell"
THREE = CELL / "viewing/page/static/three/three.module.min.js"  # MIT, as LICENSE beside it says
FONTS = (
    "fonts-dejavu-core",
    "Bitstream-Vera",
)  # of the system; by its copyright file, DejaVu's changes are public domain
MESHES_LICENCE = "BSD-3-Clause"  # config/robots/ur10/LICENSE
PIN = re.compile(r"^([\w.-]+)==(\S+)", re.MULTILINE)


def bill() -> Bom:
    """All pinned packages, and what comes with the program: weights, robots, the page's library; the system's fonts."""
    project = tomllib.loads((ROOT / "cell" / "pyproject.toml").read_text())["project"]
    whole = _component(project["name"], LICENCE, ComponentType.APPLICATION, version=project["version"])
    bom = Bom(components=[*_packages(), *_shipped()])
    bom.metadata.component = whole
    bom.register_dependency(whole, bom.components)
    return bom


def _packages() -> Iterator[Component]:
    for name, version in PIN.findall((ROOT / "constraints.txt").read_text()):
        address = PackageURL("pypi", name=name, version=version)
        yield Component(name=name, version=version, type=ComponentType.LIBRARY, purl=address, bom_ref=str(address))


def _shipped() -> Iterator[Component]:
    for path in sorted((CELL / "learned" / "weights").glob("*.onnx")):
        yield _file(path, LICENCE, ComponentType.MACHINE_LEARNING_MODEL)
    for path in sorted([*(CELL / "config").rglob("*.stl"), *(CELL / "config").rglob("*.urdf")]):
        yield _file(path, MESHES_LICENCE, ComponentType.FILE)
    [three] = re.findall(r"^THREE = (\S+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    yield _file(THREE, "MIT", ComponentType.LIBRARY, version=three, purl=PackageURL("npm", name="three", version=three))
    fonts, licence = FONTS
    yield _component(fonts, licence, ComponentType.DATA, purl=PackageURL("deb", "debian", fonts))


def _file(path: Path, licence: str, kind: ComponentType, **more: Any) -> Component:
    digest = HashType(alg=HashAlgorithm.SHA_256, content=sha256(path.read_bytes()).hexdigest())
    return _component(str(path.relative_to(ROOT)), licence, kind, hashes=[digest], **more)


def _component(name: str, licence: str, kind: ComponentType, **more: Any) -> Component:
    return Component(name=name, type=kind, licenses=[DisjunctiveLicense(id=licence)], bom_ref=name, **more)


def written(bom: Bom) -> str:
    return make_outputter(bom, OutputFormat.JSON, VERSION).output_as_string(indent=2)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.parent.mkdir(parents=True, exist_ok=True)
    write_whole(target, written(bill()).encode())
    print(target)
