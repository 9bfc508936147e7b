"""What detectors share when they run; free of torch."""
