"""Planners and detectors at run time, with their shipped weights."""

import bracket_ground.errors  # noqa: F401 - `cell` switches ONNX Runtime's telemetry off, which must be before that is imported
