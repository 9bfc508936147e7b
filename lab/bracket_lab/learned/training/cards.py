"""Writes the model cards beside the shipped weights, from their metadata."""

from __future__ import annotations

from pathlib import Path

from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import ModelCard, OnnxModel, digest_of
from bracket_ground.files.files import write_whole

CARDS = WEIGHTS / "README.md"
LICENCE = "Apache-2.0"  # of this project, and so of the weights that it made
NOT_RECORDED = "not recorded"
HEAD = f"""# Model cards of the shipped weights

Made by `python -m bracket_lab.learned.training.cards` from the files' metadata. Licence of all weights: {LICENCE}.
Their training data are what the command makes: scenes and images of the simulator, with labels of its truth. Where the
metadata tell of photographs beside, the card has their number and licence by source, or that they are not recorded.
"""


def cards(folder: Path) -> str:
    """Model cards of all weights of a folder, in Markdown.

    Raises:
        ModelError: a file is not one of this project's weights.
    """
    return "\n".join([HEAD, *(_section(path, OnnxModel.card_of(path)) for path in sorted(folder.glob("*.onnx")))])


def _section(path: Path, card: ModelCard) -> str:
    rows = {
        "kind": f"`{card.kind}`",
        "SHA-256": f"`{digest_of(path.read_bytes())}`",
        "licence": LICENCE,
        "made by": f"`{card.command}`, seed {card.seed}" if card.command else NOT_RECORDED,
        "SHA-256 of the data": f"`{card.data_sha256}`" if card.data_sha256 else NOT_RECORDED,
        "photographs": _photographs(card),
        "trained for": "; ".join(f"{use}: {', '.join(words)}" for use, words in card.vocabulary.items()),
        "settings": ", ".join(
            f"{name} {value}" for name, value in card.config.items() if isinstance(value, str | int | float)
        ),
        "scores": ", ".join(f"{name} {score:.4g}" for name, score in card.scores.items()) or NOT_RECORDED,
    }
    return "\n".join([f"## {path.name}", "", "| | |", "|---|---|", *(f"| {row} | {rows[row]} |" for row in rows), ""])


def _photographs(card: ModelCard) -> str:
    """Number and licence by source; of a card without these, whether its settings tell of photographs."""
    if isinstance(sources := card.config.get("photographs"), dict):
        return "; ".join(f"{source}: {told}" for source, told in sources.items())
    used = any("photograph" in value for value in card.config.values() if isinstance(value, str))
    return f"used; source: {NOT_RECORDED}; licence: {NOT_RECORDED}" if used else "none named in the metadata"


if __name__ == "__main__":
    write_whole(CARDS, cards(WEIGHTS).encode())
