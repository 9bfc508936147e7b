"""Planners and detectors: their graphs, data sets, training and shipped weights."""

import cell.errors  # noqa: F401 - `cell` switches ONNX Runtime's telemetry off, which must be before that is imported
