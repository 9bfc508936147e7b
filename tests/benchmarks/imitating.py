"""How fast ACT learns to reach by imitation: share of fresh trays that it reaches, by steps of training.

    python -m tests.benchmarks.imitating --trainings 3 --out docs/figures/imitating.svg

LeRobot's policy, trained on what a hand-written rule does in `cell/Reach-v0`: straight to the target. It runs with the
Python of `make readers`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from bracket_cell.skills.follow_policy import STEP_M
from tests.benchmarks.learning import draw

NAME = "bracket_sim.gymnasium_env:cell/Reach-v0"
SHOWN, TRIED, FIRST_TRIED = 200, 40, 100_000  # trays that are shown and tried; seeds of the first kind begin at 0
STEPS, EVERY, BATCH, CHUNK = 6_000, 1_000, 64, 8
STATE, PLACES, ACTION, PADDED = "observation.state", "observation.environment_state", "action", "action_is_pad"
Array = NDArray[np.float32]
Batch = dict[str, torch.Tensor]
Row = tuple[int, int, int]  # steps of training, successes, episodes


def seen(observation: dict[str, Array]) -> dict[str, Array]:
    """An observation as LeRobot names it."""
    return {STATE: observation["state"], PLACES: np.concatenate([observation["part"], observation["target"]])}


def rule(env: Any) -> Array:
    """The action of the demonstrator: the tool straight to the target."""
    now = env.unwrapped._moment()
    action: Array = np.zeros(env.action_space.shape, np.float32)
    action[:3] = np.clip((now.target_m - now.tool_m) / STEP_M, -1.0, 1.0)
    return action


def episode(env: Any, seed: int, act: Callable[[dict[str, Array]], Array]) -> tuple[list[dict[str, Array]], bool]:
    """What was seen and done on one tray, and whether it succeeded."""
    observation, _ = env.reset(seed=seed)
    rows, over, told = [], False, {"is_success": False}
    while not over:
        now = seen(observation)
        action = act(now)
        rows.append({**now, ACTION: action})
        observation, _, ended, cut, told = env.step(action)
        over = ended or cut
    return rows, bool(told["is_success"])


def chunks(episodes: list[list[dict[str, Array]]]) -> Batch:
    """Every row with the CHUNK actions that follow; behind the end of an episode they are padded."""
    found: dict[str, list[Any]] = {STATE: [], PLACES: [], ACTION: [], PADDED: []}
    for rows in episodes:
        for at, row in enumerate(rows):
            later = [rows[min(n, len(rows) - 1)][ACTION] for n in range(at, at + CHUNK)]
            found[STATE].append(row[STATE])
            found[PLACES].append(row[PLACES])
            found[ACTION].append(later)
            found[PADDED].append([n >= len(rows) for n in range(at, at + CHUNK)])
    return {name: torch.as_tensor(np.array(value)) for name, value in found.items()}


def policy_of(shown: Batch) -> Any:
    """An untrained ACT policy of a size for six numbers and no image."""
    from lerobot.configs.types import FeatureType, PolicyFeature  # type: ignore[import-not-found]
    from lerobot.policies.act.configuration_act import ACTConfig  # type: ignore[import-not-found]
    from lerobot.policies.act.modeling_act import ACTPolicy  # type: ignore[import-not-found]

    kinds = {STATE: FeatureType.STATE, PLACES: FeatureType.ENV}
    inputs = {name: PolicyFeature(type=kind, shape=(shown[name].shape[-1],)) for name, kind in kinds.items()}
    outputs = {ACTION: PolicyFeature(type=FeatureType.ACTION, shape=(shown[ACTION].shape[-1],))}
    size = {"dim_model": 128, "n_heads": 4, "dim_feedforward": 256, "n_encoder_layers": 2, "n_vae_encoder_layers": 2}
    return ACTPolicy(
        ACTConfig(
            input_features=inputs, output_features=outputs, device="cpu", chunk_size=CHUNK, n_action_steps=2, **size
        )
    )


def learned(env: Any, shown: Batch, training: int) -> list[Row]:
    """The curve of one training: the trays are the same at every point."""
    torch.manual_seed(training)
    spread = {name: (shown[name].mean(0), shown[name].std(0) + 1e-3) for name in (STATE, PLACES)}
    scaled = shown | {name: (shown[name] - mean) / deviation for name, (mean, deviation) in spread.items()}
    policy = policy_of(shown)
    optimiser = torch.optim.AdamW(policy.parameters(), lr=5e-4)
    rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)

    def act(now: dict[str, Array]) -> Array:
        told = {name: ((torch.from_numpy(now[name]) - mean) / by)[None] for name, (mean, by) in spread.items()}
        action: Array = policy.select_action(told)[0].numpy()
        return action

    rows = []
    for step in range(STEPS + 1):
        if step % EVERY == 0:
            policy.eval()
            good = 0
            for seed in range(FIRST_TRIED, FIRST_TRIED + TRIED):
                policy.reset()
                good += episode(env, seed, act)[1]
            rows.append((step, good, TRIED))
            print(json.dumps({"training": training, "steps, successes, episodes": rows[-1]}), flush=True)
        policy.train()
        drawn = torch.randint(len(scaled[STATE]), (BATCH,))
        loss, _ = policy.forward({name: value[drawn] for name, value in scaled.items()})
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rate.step()
    return rows


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trainings", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("imitating.svg"))
    options = parser.parse_args()
    env = gymnasium.make(NAME, physics=False)
    told = [episode(env, seed, lambda _: rule(env)) for seed in range(SHOWN)]
    print(json.dumps({"demonstrations, successes": [SHOWN, sum(good for _, good in told)]}), flush=True)
    shown = chunks([rows for rows, good in told if good])
    rows = [learned(env, shown, training) for training in range(options.trainings)]
    draw(rows, "ACT", "fresh trays that are reached", options.out)


if __name__ == "__main__":
    main()
