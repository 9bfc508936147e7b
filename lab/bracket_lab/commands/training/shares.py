"""Which recordings a training makes for itself: of which looks, from which seeds on, and those for the scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bracket_ground.errors import InputError
from bracket_lab.commands.training.made_data import make_data, require_usable
from bracket_lab.commands.training.weights import Training
from bracket_lab.recorded.manifest import logs_by_hash

VALIDATION_SEED = 800_000


@dataclass(frozen=True)
class Share:
    """Some of the recordings to learn from: of what look, which share of all, from which seed on.

    Attributes:
        tracker: sees the hand in them; None for the truth.
    """

    look: str
    share: float
    first_seed: int
    physics: bool = False
    tracker: str | None = None

    @property
    def flags(self) -> tuple[str, ...]:
        """Words of `cell lab data` for such recordings."""
        return (*["--physics"] * self.physics, *[f"--tracker={self.tracker}"] * bool(self.tracker))


HANDS = (
    Share("people", 0.5, 0),
    Share("varied", 0.2, 300_000),
    Share("human", 0.15, 320_000),
    Share("nominal", 0.15, 500_000),
)
STILLS = (Share("wide", 0.55, 0), Share("varied", 0.3, 300_000), Share("nominal", 0.15, 500_000))
ACTIONS = (
    Share("people", 0.26, 0),
    Share("varied", 0.18, 300_000),
    Share("nominal", 0.09, 500_000),
    Share("people", 0.23, 100_000, physics=True),
    Share("varied", 0.11, 400_000, physics=True),
    Share("nominal", 0.04, 450_000, physics=True),
    Share("bare", 0.05, 340_000, tracker="mediapipe"),
    Share("bare", 0.04, 410_000, physics=True, tracker="mediapipe"),
)


def made(
    asked: Training,
    weights: Path,
    what: str,
    shares: Sequence[Share],
    count: int,
    options: Mapping[str, object] | None = None,
    flags: Sequence[str] = (),
    *,
    validation: int = 0,
    piece: int = 0,
) -> tuple[list[Path], Path]:
    """Folders of data to learn from, unless some are given, and one for the scores; made unless they are there.

    Args:
        what: the data set.
        count: recordings to learn from.
        options: of those, besides look and seeds.
        validation: recordings for the scores; 0 for none.
        piece: recordings of a folder at most; 0 for all of one share.
    """
    unseen = weights.with_suffix(".validation")
    wanted: dict[Path, tuple[dict[str, object], tuple[str, ...]]] = {}
    for share in () if asked.data and not asked.simulated else shares:
        of_share = max(1, round(share.share * count)) if not piece else round(share.share * count)
        for first in range(0, of_share, piece or of_share):
            end = min(first + (piece or of_share), of_share)
            details = [*["physics"] * share.physics, *[share.tracker or ""] * bool(share.tracker)]
            name = "-".join([Path(share.look).stem, *details, *[f"{first:06d}"] * bool(piece)])
            of_seeds = {"--look": share.look, "--seeds": f"{share.first_seed + first}:{share.first_seed + end}"}
            given = {**of_seeds, **(options or {}), "--config": asked.config}
            wanted[weights.with_suffix(".data") / name] = given, (*flags, *share.flags)
    scored = {unseen: _validation(asked, validation)} if validation else {}
    require_usable(*wanted, *scored)
    of_scores = (*flags, *[f"--tracker={asked.tracker}"] * bool(asked.tracker))
    for folder, (given, words) in {**{key: (rows, of_scores) for key, rows in scored.items()}, **wanted}.items():
        make_data(what, folder, given, *words)
    return [*(asked.data or ()), *wanted], unseen


def _validation(asked: Training, count: int) -> dict[str, object]:
    seeds = f"{VALIDATION_SEED}:{VALIDATION_SEED + count}"
    return {"--look": asked.look or "varied", "--seeds": seeds, "--config": asked.config}


def require_apart(data: Sequence[Path], validation: Path | None) -> None:
    """Check that scores are of other segments than those that are learned from.

    Raises:
        InputError: they are of the same folder, or of the same log.
    """
    if validation and not data:
        raise InputError("--validation goes with --data: what is made is kept apart by itself")
    if validation is None:
        return
    kept, why = logs_by_hash(validation), "scores on the training data say nothing"
    for folder in data:
        if folder.resolve() == validation.resolve():
            raise InputError(f"--validation {validation}: is --data, too; {why}")
        if both := kept.keys() & logs_by_hash(folder).keys():
            log = kept[min(both)]
            raise InputError(f"--validation {validation}: was made from {log}, as --data {folder} was; {why}")
