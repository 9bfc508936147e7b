"""A policy that LeRobot trained, ACT or diffusion, as the ONNX file that the leaf `RunPolicy` loads.

    python from_lerobot.py outputs/train/…/pretrained_model policy.onnx --every 5

It runs where LeRobot is installed, and needs nothing else of this project. Normalisation goes into the file, so that it
takes what `bracket_cell.learned.inference.policy` names, and answers rows of joints in [rad] and the opening in [m].
A policy that looks back sees the present as its past, as LeRobot's do after a reset. A diffusion policy gets the steps
of DDIM (Song et al. 2021, arXiv:2010.02502) from one drawn noise, so that it answers the same every time.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

STATE, ACTION, IMAGES = "observation.state", "action", "observation.images"
OPSET = 18
DENOISED = 10  # steps of a diffusion policy; LeRobot's own default is as many as in training


class Exported(nn.Module):
    """What the file holds: normalise, ask the network, keep some rows, and undo the normalisation.

    Args:
        rows: of a chunk that are kept, as numbers.
    """

    noise: Tensor

    def __init__(self, policy: Any, before: Any, after: Any, rows: list[int]) -> None:
        super().__init__()
        self.policy, self.before, self.after, self.rows = policy, before, after, rows
        self.names = list(policy.config.input_features)
        if policy.config.type == "diffusion":
            shape = (1, policy.config.horizon, policy.config.action_feature.shape[0])
            self.register_buffer("noise", torch.randn(shape, generator=torch.Generator().manual_seed(0)))
            self.times, self.tells_noise = self._steps(), policy.config.prediction_type == "epsilon"
            self.most = policy.config.clip_sample_range if policy.config.clip_sample else math.inf

    def forward(self, *inputs: Tensor) -> Tensor:
        """Rows (1, k, n) for inputs in the order of `names`."""
        features = self.policy.config.input_features
        seen = {
            name: self.before._apply_transform(value, name, features[name].type)
            for name, value in zip(self.names, inputs, strict=True)
        }
        chunk = self._act(seen) if self.policy.config.type == "act" else self._denoised(seen)
        kind = self.policy.config.output_features[ACTION].type
        actions: Tensor = self.after._apply_transform(chunk[:, self.rows], ACTION, kind, inverse=True)
        return actions

    def _act(self, seen: dict[str, Tensor]) -> Tensor:
        images = [seen[name] for name in self.policy.config.image_features]
        chunk: Tensor = self.policy.model({**seen, **({IMAGES: images} if images else {})})[0]
        return chunk

    def _denoised(self, seen: dict[str, Tensor]) -> Tensor:
        times = self.policy.config.n_obs_steps
        past = {name: torch.stack([value] * times, dim=1) for name, value in seen.items()}
        if self.policy.config.image_features:
            past[IMAGES] = torch.stack([past[name] for name in self.policy.config.image_features], dim=-4)
        model, sample, start = self.policy.diffusion, self.noise, times - 1
        seen_all = model._prepare_global_conditioning(past)
        for at, share, share_after in self.times:
            predicted = model.unet(sample, torch.full((1,), at, dtype=torch.long), global_cond=seen_all)
            clean = (sample - math.sqrt(1 - share) * predicted) / math.sqrt(share) if self.tells_noise else predicted
            noise = (sample - math.sqrt(share) * clean) / math.sqrt(1 - share)
            clean = clean.clamp(-self.most, self.most)
            sample = math.sqrt(share_after) * clean + math.sqrt(1 - share_after) * noise
        return sample[:, start : start + self.policy.config.n_action_steps]

    def _steps(self) -> list[tuple[int, float, float]]:
        """Of DDIM: number of the noise's step, and the signal's share of the variance at it and behind it."""
        scheduler, trained = self.policy.diffusion.noise_scheduler, self.policy.config.num_train_timesteps
        shares = [float(alpha) for alpha in scheduler.alphas_cumprod]
        stride = trained // min(DENOISED, trained)
        numbers = list(range(0, trained, stride))[::-1]
        return [(at, shares[at], shares[at - stride] if at >= stride else 1.0) for at in numbers]


def exported(checkpoint: Path, every: int) -> Exported:
    """The network of a checkpoint, ready to be written.

    Args:
        every: of so many rows of a chunk one is kept, the last of them.

    Raises:
        SystemExit: it is no policy of these two kinds, or has fewer rows.
    """
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors  # type: ignore[import-not-found]
    from lerobot.processor import NormalizerProcessorStep, UnnormalizerProcessorStep  # type: ignore[import-not-found]

    kind = json.loads((checkpoint / "config.json").read_text())["type"]
    if kind not in ("act", "diffusion"):
        raise SystemExit(f"{checkpoint}: is a {kind!r} policy; legal: act, diffusion")
    policy = get_policy_class(kind).from_pretrained(str(checkpoint))
    policy.to("cpu").eval()
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(checkpoint))
    [normalise] = [step for step in before.steps if isinstance(step, NormalizerProcessorStep)]
    [undo] = [step for step in after.steps if isinstance(step, UnnormalizerProcessorStep)]
    rows = list(range(every - 1, policy.config.n_action_steps, every))
    if not rows:
        raise SystemExit(f"{checkpoint}: answers {policy.config.n_action_steps} rows; --every {every} keeps none")
    return Exported(policy, normalise, undo, rows)


def write(module: Exported, target: Path) -> None:
    """Write the file, with its weights inside."""
    features = module.policy.config.input_features
    inputs = tuple(torch.zeros(1, *features[name].shape) for name in module.names)
    with torch.no_grad():
        torch.onnx.export(
            module, inputs, str(target), input_names=module.names, output_names=[ACTION], opset_version=OPSET,
            external_data=False, dynamo=True,
        )  # fmt: skip


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("checkpoint", type=Path, help="folder `pretrained_model` of a training")
    parser.add_argument("target", type=Path, help="the ONNX file")
    parser.add_argument("--every", type=int, default=1, help="keep every Nth row of a chunk")
    options = parser.parse_args()
    write(exported(options.checkpoint, max(1, options.every)), options.target)


if __name__ == "__main__":
    main()
