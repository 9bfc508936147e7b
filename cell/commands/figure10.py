"""`cell eval figure10`: the paper's Fig. 10, detectors of actions against baselines over five splits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.commands.made_data import make_data
from cell.commands.terminal import CONFIGURATION, ConfigOption, JsonOption, SeedOption, console, print_json
from cell.commands.weights import need_torch
from cell.errors import InputError


def figure10(
    out: Annotated[Path, typer.Option(help="Keeps a line of JSON for each split and network; recordings beside it.")],
    recordings: Annotated[int, typer.Option(min=5, help="Assemblies that are split.")] = 30,
    look: Annotated[str, typer.Option(help="nominal, varied, hard, or a look file.")] = "varied",
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first assembly.")] = 600_000,
    kind: Annotated[
        list[str] | None, typer.Option(help="slim, paper, cnn_lstm, hand or lrcn; may be repeated. All by default.")
    ] = None,
    epochs: Annotated[int, typer.Option(min=1, help="Passes through the data.")] = 10,
    share: Annotated[
        float, typer.Option(min=0.05, max=1, help="Of VGG16's channels; 1 where a GPU is at hand.")
    ] = 0.125,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> int:
    """Train each network on four fifths of the recordings and score it on the last, five times.

    Interrupted, it prints the table of what was measured; typed again, it goes on there.
    """
    need_torch()
    from cell.configuration import load_configuration, load_product
    from cell.files.row_store import RowStore
    from learned.actions.data import load_segments
    from learned.actions.settings import WHOLE_FRAMES, ActionTraining
    from learned.actions.train import Task
    from learned.lab.action_baselines import FOLDS, KINDS, measure_folds, page, summary

    kinds = kind or list(KINDS)
    if unknown := [one for one in kinds if one not in KINDS]:
        raise InputError(f"--kind {unknown[0]}: legal: {', '.join(KINDS)}")
    told = {"look": look, "first_seed": first_seed, "recordings": recordings, "epochs": epochs, "share": share}
    kept = RowStore(out, ["fold", "kind"], {"command": "figure10", **told, "seed": seed})
    wanted = [(fold, one) for fold in range(FOLDS) for one in kinds if (fold, one) not in kept]
    status = 0
    if wanted:
        whole = any(one in WHOLE_FRAMES for _, one in wanted)
        folder = out.with_suffix(".frames" if whole else ".data")
        options = {"--look": look, "--recordings": recordings, "--first-seed": first_seed, "--config": config}
        make_data("actions", folder, options, "--thin", *(["--frames"] if whole else []))
        configuration = load_configuration(config)
        task = Task(configuration.bench, load_product(configuration, config))
        settings = ActionTraining(epochs=epochs, share=share)
        try:
            for row in measure_folds(task, load_segments([folder], task.classes), wanted, settings, seed=seed):
                kept.add(row)
                console().print(row, highlight=False)
        except KeyboardInterrupt:
            console().print(f"interrupted: {len(kept.rows)} of {FOLDS * len(kinds)} trainings are done")
            status = 1
    console().print(page(kept.rows), highlight=False, soft_wrap=True)
    if as_json:
        print_json({**told, "rows": summary(kept.rows)})
    return status
