"""Many runs: one store, one scheduler, comparisons."""
