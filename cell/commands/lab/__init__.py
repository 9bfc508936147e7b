"""`cell lab`: commands for research. Everything of it stays in a clone; no command of the product imports it."""

from __future__ import annotations

from cell.commands.table import Command

EVALUATIONS = {
    name: Command(f"cell.commands.lab.{module}", text)
    for name, module, text in (
        ("actions", "actions:evaluate", "Action detectors on whole assemblies."),
        ("cameras", "things:evaluate_cameras", "Calibration: errors of the cameras before and after it."),
        ("encounters", "encounters:encounters", "A person who gets into the arm's way: contacts."),
        ("faults", "faults:faults", "Every fault in every state of a pick and place."),
        ("figure10", "figure10:figure10", "The paper's Fig. 10: action detectors over five splits."),
        ("grasp", "planners:evaluate_grasp_planner", "The grasp planner, or an experiment with all of them."),
        ("hands", "hands:evaluate", "Hand trackers, or MediaPipe's networks on photographs."),
        ("holes", "things:evaluate_holes", "A hole reader on stills of the plate."),
        ("knobs", "knobs:knobs", "A detector, while one value of the look changes."),
        ("latency", "system:latency", "Processor time of the detectors for a frame."),
        ("parts", "things:evaluate_parts", "A part detector on images of trays."),
        ("semantic", "planners:evaluate_semantic_planner", "The semantic planner, its certificate, or an experiment."),
        ("system", "system:system", "Whole assemblies: detections, guidance and products."),
        ("weights", "same_weights:evaluate_weights", "Trained weights compared with others."),
    )
}
COMMANDS = {
    "run": Command("cell.commands.lab.run:run", "Run as `cell run` does, with the options of experiments too."),
    "eval": Command("cell.commands.lab:EVALUATIONS", "Score planners, detectors and whole assemblies.", group=True),
    "data": Command("cell.commands.lab.data:data_app", "Make training data, drawn or from logs."),
    "train": Command("cell.commands.lab.train:train_app", "Train one network, with all its options."),
    "sweep": Command("cell.commands.lab.sweep:sweep", "Run every combination of a file once."),
    "looks": Command("cell.commands.lab.looks:looks", "List or draw what the simulation may look like."),
    "see": Command("cell.commands.lab.see:see", "Draw what detectors find in pictures, a video, a log or a camera."),
    "world": Command("cell.commands.lab.world:world", "Simulate a cell for controllers that come and go."),
    "schema": Command("cell.commands.lab.schema:schema", "Write JSON schemas of all YAML files, for editors."),
    "hands": Command("cell.commands.lab.hands:fetch", "Fetch MediaPipe's hand networks."),
    "files": Command("cell.commands.lab.logs:files", "Write the files that a run was made with."),
    "sheet": Command("cell.commands.lab.logs:sheet", "Draw the contact sheet of a run."),
    "snapshots": Command("cell.commands.lab.logs:snapshots", "Write the pictures that a tree took."),
}
