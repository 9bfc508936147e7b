"""`cell lab eval figure10`: the paper's Fig. 10, detectors of actions against baselines over five splits."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from bracket_cell.commands.options import command_from
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_lab.commands.shared import Shared
from bracket_lab.commands.training.made_data import make_data
from bracket_lab.learned.training.schedule import MOST_EPOCHS


@command_from(Shared, "kind", "look", "seeds", "out", "config", "seed", "as_json", seeds="600000:600030")
def figure10(
    shared: Shared,
    epochs: Annotated[int, Option(min=1, max=MOST_EPOCHS, help="Passes through the data.")] = 10,
    share: Annotated[float, Option(min=0.05, max=1, help="Share of VGG16's channels; 1 with a GPU.")] = 0.125,
) -> int:
    """Train and score action detectors on five splits, as Fig. 10 of the paper; needs --out.

    Kinds: slim, paper, cnn_lstm, hand, lrcn; all by default. Interrupted, it prints the table of what was measured;
    typed again, it goes on there.
    """
    from bracket_cell.learned.actions.settings import WHOLE_FRAMES, ActionTraining
    from bracket_lab.experiments.paper import actions
    from bracket_lab.experiments.paper.actions import FOLDS, KINDS, measure_folds, page, shares
    from bracket_lab.learned.actions.data import load_segments
    from bracket_lab.learned.actions.train import Task

    kinds, out, seeds = shared.kind or list(KINDS), shared.out, shared.numbers
    if unknown := [kind for kind in kinds if kind not in KINDS]:
        raise InputError(f"--kind {unknown[0]}: unknown kind; legal: {', '.join(KINDS)}")
    if out is None or len(seeds) < FOLDS:
        raise InputError(f"figure10 needs --out FILE, and at least {FOLDS} --seeds, as 600000:600030")
    fields = {"look": shared.look, "seeds": shared.seeds, "epochs": epochs, "share": share}
    kept = shared.rows(["fold", "kind"], {"command": "figure10", **fields, "seed": shared.seed}, actions)
    wanted = [(fold, kind) for fold in range(FOLDS) for kind in kinds if (fold, kind) not in kept]
    status = 0
    if wanted:
        whole = any(kind in WHOLE_FRAMES for _, kind in wanted)
        folder = out.with_suffix(".frames" if whole else ".data")
        options = {"--look": shared.look, "--seeds": shared.seeds, "--config": shared.config}
        make_data("actions", folder, options, "--thin", *(["--frames"] if whole else []))
        configuration = load_configuration(shared.config)
        task = Task(configuration.bench, load_product(configuration, shared.config))
        segments, settings = load_segments([folder], task.classes), ActionTraining(epochs=epochs, share=share)
        try:
            for row in measure_folds(task, segments, wanted, settings, seed=shared.seed):
                kept.add(row)
                console().print(row, highlight=False)
        except KeyboardInterrupt:
            console().print(f"interrupted: {len(kept.rows)} of {FOLDS * len(kinds)} trainings are done")
            status = 1
    console().print(page(kept.rows), highlight=False, soft_wrap=True)
    if shared.as_json:
        print_json({**fields, "kinds": shares(kept.rows)})
    return status
