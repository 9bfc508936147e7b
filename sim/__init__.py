"""The simulated cell: world, devices, worker and scoring."""
