"""The cell as a Gymnasium environment passes Gymnasium's own checker, and pays for coming nearer."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from bracket_cell.learned.inference.policy import ENVIRONMENT
from bracket_sim.gymnasium_env import ABOVE_M, NAME, AbovePart, register


@pytest.mark.filterwarnings("ignore:.*normalized space")  # actions are joints, as the policy in the cell has them
def test_it_is_made_by_name_and_passes_the_checker() -> None:
    register()
    made = gymnasium.make(NAME)
    assert made.spec is not None
    check_env(made.unwrapped, skip_render_check=True)
    made.close()


def test_the_way_above_the_part_ends_the_episode_and_a_way_through_the_table_is_refused() -> None:
    env = AbovePart()
    seen, told = env.reset(seed=3, options={"part": "o1"})
    assert told["part"] == "o1"
    start = np.array(seen["observation.state"][:6])
    x, y, z = seen[ENVIRONMENT]
    down = env.above(np.array((x, y, z - 0.3 - ABOVE_M)), start)
    _, reward, ended, _, info = env.step(down)
    assert info["refused"]
    assert reward < -1.0
    assert not ended
    seen, reward, ended, _, info = env.step(env.above(np.array((x, y, z)), start))
    assert ended, info
    assert reward > -0.01
    with pytest.raises(ValueError, match="no part 'o9'"):
        env.reset(seed=3, options={"part": "o9"})
    env.close()
