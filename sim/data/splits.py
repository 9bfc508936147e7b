"""Which seeds are for training, which for validation and which for tests; no seed is in two of them."""

from __future__ import annotations

from cell.interfaces.errors import InputError

SPLITS = {"train": range(800_000), "validation": range(800_000, 900_000), "test": range(900_000, 1_000_000)}


def seeds(first_seed: int, recordings: int) -> tuple[str, range]:
    """The split of so many seeds in a row, and the seeds.

    Raises:
        InputError: they are not all of one split.
    """
    asked = range(first_seed, first_seed + recordings)
    for name, split in SPLITS.items():
        if asked and asked[0] in split and asked[-1] in split:
            return name, asked
    legal = ", ".join(f"{name} {split[0]} to {split[-1]}" for name, split in SPLITS.items())
    raise InputError(f"seeds {first_seed} to {first_seed + recordings - 1} are not of one split; legal: {legal}")
