"""The cell as Gymnasium environments: found by name in a fresh process, checked by Gymnasium, solved by a script."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.pose import Array
from bracket_sim.gymnasium_env import TASKS, CellTask

NAME = "bracket_sim.gymnasium_env:cell/{}-v0"


def test_a_fresh_process_makes_it_by_name() -> None:
    program = f"import gymnasium; env = gymnasium.make({NAME.format('Grasp')!r}); env.reset(seed=1); env.close()"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_gymnasiums_checker_and_torch_take_it() -> None:
    env = CellTask("Reach")
    check_env(env, skip_render_check=True)
    assert not any("." in name for name in env.observation_space)  # a torch.nn.ModuleDict takes no dots
    env.close()


def to(tool_m: Array, goal_m: Array, fingers: float) -> Array:
    """The step towards a place."""
    return np.array([*np.clip((goal_m - tool_m) / 0.04, -1, 1), 0.0, fingers], np.float32)


def tool_m(env: CellTask, seen: dict[str, Array]) -> Array:
    return np.asarray(env._motion.kinematics.position_m(seen["state"][:6].astype(float)))


def test_a_script_reaches_and_a_way_through_the_table_is_refused() -> None:
    env = CellTask("Reach")
    seen, told = env.reset(seed=3, options={"part": "o1"})
    assert told["part"] == "o1"
    ended, total, steps = False, 0.0, 0
    while not ended and steps < 60:
        seen, reward, ended, _, told = env.step(to(tool_m(env, seen), seen["target"], 1.0))
        total, steps = total + reward, steps + 1
    assert ended, told
    assert total > 1.0
    refused = []
    for _ in range(12):
        *_, told = env.step(np.array([0, 0, -1, 0, 1], np.float32))
        refused.append(bool(told["refused"]))
    assert refused[-1], "it went through the table"
    with pytest.raises(ValueError, match="no part 'o9'"):
        env.reset(seed=3, options={"part": "o9"})
    env.close()


def test_without_physics_the_arm_comes_to_the_same_places_and_parts_stay() -> None:
    places = []
    for physics in (True, False):
        env = CellTask("Reach", physics=physics)
        seen, _ = env.reset(seed=3)
        part_m = seen["part"]
        for _ in range(6):
            seen, *_, told = env.step(to(tool_m(env, seen), seen["target"], 1.0))
            assert not told["refused"]
        places.append(tool_m(env, seen))
        assert np.allclose(seen["part"], part_m, atol=0.001)
        env.close()
    assert np.linalg.norm(places[0] - places[1]) < 0.003
    with pytest.raises(ValueError, match="without physics"):
        CellTask("Reach", physics=False, person=True)


@pytest.mark.slow
def test_what_is_touched_and_what_is_held_has_physics_all_the_same() -> None:
    env = CellTask("Grasp", physics=False)
    seen, _ = env.reset(seed=3, options={"part": "o1"})
    jumps = []
    jumped = env._jumped
    env._jumped = lambda way: jumps.append(jumped(way)) or jumps[-1]  # type: ignore[method-assign, func-returns-value]
    for _ in range(40):
        seen, *_ = env.step(to(tool_m(env, seen), seen["part"] - (0, 0, 0.02), 1.0))
        if jumps[-1:] == [False]:
            break
    assert True in jumps
    assert False in jumps, "fingers went into a part"
    env.close()


def test_the_same_seed_is_the_same_episode_also_side_by_side() -> None:
    both = gymnasium.make_vec(NAME.format("Reach"), num_envs=2, vectorization_mode="sync")
    seeds: Any = [5, 5]  # as the library takes them
    first, _ = both.reset(seed=seeds)
    assert all(np.array_equal(rows[0], rows[1]) for rows in first.values())
    after, rewards, *_ = both.step(np.tile(np.array([0.5, 0.2, 0, 0, 1], np.float32), (2, 1)))
    assert rewards[0] == rewards[1]
    assert all(np.array_equal(rows[0], rows[1]) for rows in after.values())
    both.close()


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_every_task_begins_and_steps(task: str) -> None:
    env = CellTask(task)
    seen, _ = env.reset(seed=2)
    for _ in range(3):
        seen, reward, *_ = env.step(to(tool_m(env, seen), seen["part"] + (0, 0, 0.16), 1.0))
        assert np.isfinite(reward)
    env.close()


@pytest.mark.slow
def test_beside_a_person_the_arm_keeps_its_distance() -> None:
    env = CellTask("Reach", person=True)
    seen, _ = env.reset(seed=2)
    for _ in range(5):
        seen, *_ = env.step(to(tool_m(env, seen), seen["target"], 1.0))
    env.close()
    with pytest.raises(ValueError, match="without images"):
        CellTask("Reach", images=("wrist",), person=True)


def test_a_protective_stop_ends_the_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    env = CellTask("Reach", physics=False)
    env.reset(seed=5)
    assert env._cell is not None

    def pushed(*_: object) -> None:
        raise DeviceFault("arm", "protective stop: something pushes the tool with 234 N, limit 150 N")

    monkeypatch.setattr(env, "_jumped", lambda _: False)
    monkeypatch.setattr(env._cell.devices.arm, "follow", pushed)
    _, reward, ended, _, told = env.step(np.array([0.0, 0.0, 0.5, 0.0, 1.0], np.float32))
    assert ended
    assert "234 N" in told["refused"]
    assert reward < 0
    env.close()
