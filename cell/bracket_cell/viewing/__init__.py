"""Shows a run while it goes on: monitor, live view, progress; runs and commands import it."""
