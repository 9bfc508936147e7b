"""The loop of observe, tick, act and record, with detectors and reload; `cell.run` and `cell.log` may import it."""
