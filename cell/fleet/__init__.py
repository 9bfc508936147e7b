"""Many runs: sweeps on one machine or a cluster, tables of runs, trees compared."""
