"""Opens exports with the packages of those who made the formats; run by the Python of `make readers`.

python open_exports.py lerobot FOLDER
"""

from __future__ import annotations

import json
import sys


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


if __name__ == "__main__":
    print(json.dumps({"lerobot": lerobot}[sys.argv[1]](sys.argv[2])))
