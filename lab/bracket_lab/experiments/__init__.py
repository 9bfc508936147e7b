"""The paper's baselines and the experiments, with their pages; left out of a wheel."""
