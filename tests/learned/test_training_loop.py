"""The training loop: an interrupted fit ends as if it had not been interrupted; foreign checkpoints are ignored."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bracket_ground.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor, nn

pytestmark = [pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning:torch.*")]
EPOCHS = 40


def trained(checkpoint: Path | None, stop: int | None = None, identity: str = "a test") -> tuple[nn.Module, list[int]]:
    """A small network, and the epochs that were gone through; noise comes from torch and from numpy."""
    import torch
    from torch import nn

    from bracket_lab.learned.training.training_loop import Checkpoint, fit

    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    network = nn.Linear(3, 1)
    seen: list[int] = []

    def losses(epoch: int) -> Iterator[Tensor]:
        if epoch == stop:
            raise KeyboardInterrupt
        seen.append(epoch)
        for _ in range(2):
            batch = torch.rand(8, 3) + torch.tensor(rng.normal(size=(8, 3)), dtype=torch.float32)
            yield (network(batch) - batch.sum(1, keepdim=True)).square().mean()

    optimiser = torch.optim.Adam(network.parameters(), 0.05)
    kept = None if checkpoint is None else Checkpoint(checkpoint, identity)
    try:
        fit(network, optimiser, losses, EPOCHS, 2, largest_gradient=1.0, rng=rng, checkpoint=kept)
    except KeyboardInterrupt:
        assert stop is not None
    return network, seen


def test_a_fit_that_was_interrupted_ends_as_if_it_had_not_been(tmp_path: Path) -> None:
    import torch

    checkpoint = tmp_path / "some.checkpoint"
    whole, _ = trained(None)
    trained(checkpoint, stop=25)
    assert checkpoint.exists()
    again, seen = trained(checkpoint)
    assert seen[0] == 24
    assert torch.equal(whole.weight, again.weight)  # type: ignore[arg-type]
    assert not whole.training


def test_a_checkpoint_of_another_fit_is_ignored(tmp_path: Path) -> None:
    checkpoint = tmp_path / "some.checkpoint"
    trained(checkpoint, stop=25)
    assert trained(checkpoint, identity="another")[1] == list(range(EPOCHS))


def test_a_fit_that_is_done_keeps_its_checkpoint_for_whoever_writes_the_file(tmp_path: Path) -> None:
    import torch

    checkpoint = tmp_path / "some.checkpoint"
    whole, _ = trained(checkpoint)
    again, seen = trained(checkpoint)
    assert not seen
    assert torch.equal(whole.weight, again.weight)  # type: ignore[arg-type]
    assert not again.training


@pytest.mark.parametrize("has_them", [True, False])
def test_numbers_are_short_only_where_the_processor_computes_with_them(
    has_them: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    import torch

    from bracket_lab.learned.training.training_loop import short_numbers

    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: has_them)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: False)
    with short_numbers():
        product = torch.rand(2, 3) @ torch.rand(3, 2)
    assert product.dtype == (torch.bfloat16 if has_them else torch.float32)


def test_a_checkpoint_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way of a folder")
    with pytest.raises(InputError, match=r"some\.checkpoint: cannot be written"):
        trained(tmp_path / "file" / "some.checkpoint")
