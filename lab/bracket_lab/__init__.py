"""The laboratory: training, data, experiments and the paper's baselines; nothing else imports it."""

import bracket_cell as _cell  # noqa: F401  (it keeps ONNX Runtime quiet, whatever is imported next)
import bracket_sim as _sim  # noqa: F401  (it says how MuJoCo renders, before that is imported)
