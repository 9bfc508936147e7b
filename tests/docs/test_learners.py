"""What docs/logs.md tells learners to type, as printed, with the packages of `make readers`; only less of it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from bracket_cell.learned.inference.policy import ACTION, Policy
from tests import ROOT

READERS = ROOT / ".venv-readers" / "bin"
PAGE = (ROOT / "docs" / "logs.md").read_text()
SMALL = (
    "--policy.dim_model=32 --policy.n_heads=2 --policy.dim_feedforward=64 --policy.n_encoder_layers=1 "
    "--policy.pretrained_backbone_weights=null --policy.device=cpu --policy.chunk_size=20 --policy.n_action_steps=20 "
    "--wandb.enable=false --num_workers=0 --batch_size=2 --steps=2"
)
OWN = """
import importlib.util, sys, torch
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from lerobot.policies.factory import make_pre_post_processors
spec = importlib.util.spec_from_file_location("from_lerobot", sys.argv[1])
script = importlib.util.module_from_spec(spec); spec.loader.exec_module(script)
from pathlib import Path
made = script.exported(Path(sys.argv[2]), 4)
policy = made.policy
before, after = make_pre_post_processors(policy.config, pretrained_path=sys.argv[2])
seen = before({name: torch.full(policy.config.input_features[name].shape, 0.3) for name in made.names})
with torch.no_grad():
    if policy.config.type == "act":
        chunk = policy.predict_action_chunk(seen)
    else:
        inner = policy.diffusion
        inner.noise_scheduler, inner.num_inference_steps = DDIMScheduler.from_config(inner.noise_scheduler.config), 10
        past = {name: torch.stack([seen[name]] * policy.config.n_obs_steps, dim=1) for name in made.names}
        chunk = inner.generate_actions(past, noise=made.noise)
print(*after(chunk)[0, made.rows[-1]].tolist())
"""
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not READERS.exists(), reason="make readers")]


def typed(command: list[str], folder: Path) -> str:
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_the_block_for_ppo_trains(tmp_path: Path) -> None:
    [block] = [one for one in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "PPO" in one]
    assert "25_000" in block
    program = block.replace("25_000", "512").replace("n_steps=512", "n_steps=256")
    typed([str(READERS / "python"), "-c", program], tmp_path)


@pytest.mark.parametrize("kind", ["act", "diffusion"])
def test_a_policy_that_lerobot_trains_is_one_that_the_cell_loads(kind: str, tmp_path: Path) -> None:
    """State and part alone, as the kept cases have no images; the last rows are compared with LeRobot's own answer."""
    commands = re.findall(r"^    ((?:cell log export|lerobot-train|python lab/).*)$", PAGE, re.MULTILINE)
    export, train, convert = commands[-3:]
    cases = [str(path) for path in sorted((ROOT / "tests" / "cases").glob("*.mcap"))[:2]]
    typed([sys.executable, "-m", "bracket_cell", *export.split()[1:3], *cases, *export.split()[4:]], tmp_path)
    words = train.replace("--policy.type=act", f"--policy.type={kind}").split()[1:]
    others = [one for one in SMALL.split() if "--policy" not in one or "device" in one]
    small = SMALL.split() if kind == "act" else others
    trained = [str(READERS / "python"), "-m", "lerobot.scripts.lerobot_train", *words, *small, "--output_dir=out"]
    typed([*trained, *([] if kind == "act" else ["--policy.down_dims=[32,64]"])], tmp_path)
    script, _, target = convert.split()[1:4]
    checkpoint = tmp_path / "out" / "checkpoints" / "last" / "pretrained_model"
    typed([str(READERS / "python"), str(ROOT / script), str(checkpoint), target, "--every", "4"], tmp_path)
    policy = Policy(tmp_path / target, 6)
    assert policy.cameras == ()
    session = onnxruntime.InferenceSession(str(tmp_path / target))
    seen = {input_.name: np.full(input_.shape, 0.3, np.float32) for input_ in session.get_inputs()}
    [answer] = session.run([ACTION], seen)
    assert np.allclose(policy.actions({name: value[0] for name, value in seen.items()}), answer[0][:, :6])
    assert len(answer[0]) == (5 if kind == "act" else 2)
    own = typed([str(READERS / "python"), "-c", OWN, str(ROOT / script), str(checkpoint)], tmp_path)
    assert np.allclose(np.array(own.split()[-7:], float), answer[0][-1], atol=1e-3)
