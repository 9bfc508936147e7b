"""How fast PPO learns to reach, by the example of docs/logs.md: shares of training episodes that succeed, by steps.

    python -m tests.benchmarks.learning --seeds 3 --out docs/figures/learning.svg

Every episode has a tray that no other has. It runs with the Python of `make readers`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

NAME, STEPS, WINDOW = "bracket_sim.gymnasium_env:cell/Reach-v0", 25_000, 2_500
RANDOM_EPISODES = 40
Episode = tuple[int, bool]  # step of the training at its end, whether it succeeded


def learned(seed: int) -> list[Episode]:
    """The episodes of one training."""
    from stable_baselines3 import PPO  # type: ignore[import-not-found]
    from stable_baselines3.common.env_util import make_vec_env  # type: ignore[import-not-found]
    from stable_baselines3.common.vec_env import VecNormalize  # type: ignore[import-not-found]

    env = VecNormalize(make_vec_env(NAME, env_kwargs={"physics": False}), norm_reward=False)
    model = PPO("MultiInputPolicy", env, n_steps=512, gamma=0.95, learning_rate=1e-3, seed=seed)
    episodes: list[Episode] = []

    def note(told: dict[str, Any], _: dict[str, Any]) -> bool:
        ended = [one for one in told["infos"] if "episode" in one]
        episodes.extend((model.num_timesteps, bool(one["is_success"])) for one in ended)
        return True

    model.learn(STEPS, callback=note)
    return episodes


def by_chance() -> tuple[int, int]:
    """(successes, episodes) of random actions."""
    import gymnasium

    env, good = gymnasium.make(NAME, physics=False), 0
    for seed in range(RANDOM_EPISODES):
        env.reset(seed=seed)
        env.action_space.seed(seed)
        over = False
        while not over:
            _, _, ended, cut, told = env.step(env.action_space.sample())
            over = ended or cut
        good += bool(told["is_success"])
    return good, RANDOM_EPISODES


def windows(episodes: Sequence[Episode]) -> list[tuple[int, int, int]]:
    """(steps, successes, episodes) of every WINDOW steps."""
    found = []
    for end in range(WINDOW, STEPS + WINDOW, WINDOW):
        within = [success for step, success in episodes if end - WINDOW < step <= end]
        found.append((end, sum(within), len(within)))
    return found


def draw(
    seeds: Sequence[Sequence[tuple[int, int, int]]],
    name: str,
    what: str,
    file: Path,
    chance: tuple[int, int] | None = None,
) -> None:
    """A line for each seed, of the share of episodes by steps; with random actions beside.

    Args:
        name: of the method.
        what: the share is of.
        chance: (successes, episodes) of random actions.
    """
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3))
    for number, rows in enumerate(seeds):
        axis.plot([end for end, *_ in rows], [good / count for _, good, count in rows], label=f"{name}, seed {number}")
    if chance is not None:
        axis.axhline(chance[0] / chance[1], color="grey", linestyle="--", label=f"random actions, n {chance[1]}")
    axis.set_xlabel("steps of training")
    axis.set_ylabel(what)
    axis.set_ylim(0, 1.02)
    axis.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("learning.svg"))
    options = parser.parse_args()
    seeds, chance = [windows(learned(seed)) for seed in range(options.seeds)], by_chance()
    for number, rows in enumerate(seeds):
        print(json.dumps({"seed": number, "steps, successes, episodes": rows}))
    print(json.dumps({"random": chance}))
    draw(seeds, "PPO", "episodes that succeed", options.out, chance)


if __name__ == "__main__":
    main()
