"""The paper's baselines, rebuilt: what experiments compare with, and no cell runs."""
