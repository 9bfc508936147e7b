"""`cell lab`: commands for research. Everything of it stays in a clone; no command of the product imports it."""

from __future__ import annotations

from bracket_cell.commands.terminal import Command

EVALUATIONS = {
    name: Command(f"bracket_lab.commands.{module}", text)
    for name, module, text in (
        ("actions", "actions:evaluate", "Score action detectors on whole assemblies."),
        ("bars", "bars:bars", "Measure what the pages of figures show."),
        ("encounters", "encounters:encounters", "Assemble next to a person who gets in the way."),
        ("faults", "faults:faults", "Put every fault into every state of a pick and place."),
        ("figure10", "figure10:figure10", "Train and score action detectors on five splits."),
        ("grasp", "planners:evaluate_grasp_planner", "Score the grasp planner."),
        ("hands", "hands:evaluate", "Score hand trackers on simulated assemblies."),
        ("holes", "things:evaluate_holes", "Score a hole reader on stills."),
        ("latency", "system:latency", "Measure the detectors' processor time for a frame."),
        ("parts", "things:evaluate_parts", "Score a part detector on images of trays."),
        ("reaches", "reaches:evaluate", "Score what a robot spares the person."),
        ("semantic", "planners:evaluate_semantic_planner", "Score the semantic planner."),
        ("separation", "encounters:separation", "Tell what keeping away from the person costs."),
        ("stacks", "stacks:evaluate_stacks", "Score planners of what lies on what."),
        ("system", "system:system", "Score whole assemblies by number of goals."),
    )
}
COMMANDS = {
    "run": Command("bracket_lab.commands.run:run", "Like `cell run`, with options for experiments."),
    "eval": Command("bracket_lab.commands:EVALUATIONS", "Score planners, detectors and whole assemblies.", group=True),
    "data": Command("bracket_lab.commands.data:data_app", "Make training data."),
    "train": Command("bracket_lab.commands.training.tasks:app", "Train one network, with all its options."),
    "sweep": Command(
        "bracket_lab.commands.sweep:sweep", "Run the cell once for every combination that a YAML file lists."
    ),
    "looks": Command("bracket_lab.commands.looks:looks", "List or draw what the simulation may look like."),
    "see": Command("bracket_lab.commands.see:see", "Draw what detectors find in pictures, a video, a log or a camera."),
    "world": Command(
        "bracket_lab.commands.run:world",
        "Run the simulated cell by itself, for controllers that connect by `cell lab run --world`.",
    ),
    "hands": Command("bracket_lab.commands.hands:fetch", "Fetch MediaPipe's hand networks."),
    "files": Command("bracket_lab.commands.logs:files", "Write the files that a run was made with."),
    "reaches": Command("bracket_lab.commands.reaches:of_logs", "Tell what the person of a run reached for."),
    "snapshots": Command("bracket_lab.commands.logs:snapshots", "Write the pictures that a tree took."),
}
