"""Opens exports with the packages of those who made the formats; run by the Python of `make readers`.

python open_exports.py lerobot FOLDER | rerun FILE
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path


def lerobot(folder: str) -> dict[str, object]:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # type: ignore[import-not-found]

    data = LeRobotDataset("local/cell", root=folder)
    items = [data[place] for place in (0, len(data) // 2, len(data) - 1)]
    return {
        "episodes": data.num_episodes,
        "rows": data.num_frames,
        "shape": list(items[0]["observation.images.overhead"].shape),
        "bright": [float(item["observation.images.overhead"].mean()) for item in items],
        "state": [item["observation.state"].tolist() for item in items],
        "tasks": [item["task"] for item in items],
        "success": bool(items[-1]["next.success"]),
    }


def rerun(file: str) -> dict[str, object]:
    program, out = str(Path(sys.executable).with_name("rerun")), f"{file}.rrd"
    subprocess.run([program, "mcap", "convert", file, "-o", out], check=True, capture_output=True)
    subprocess.run([program, "rrd", "verify", out], check=True, capture_output=True)
    command = [program, "rrd", "print", "-vvv", out, "--entity", "/decisions/skill"]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return {"text": "TextLog:text" in shown, "words": shown.count("skill MoveTo running")}


if __name__ == "__main__":
    print(json.dumps({"lerobot": lerobot, "rerun": rerun}[sys.argv[1]](sys.argv[2])))
