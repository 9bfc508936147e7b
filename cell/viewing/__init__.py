"""Shows a run while it goes on: monitor, live view, progress; `cell.runs.run` and `cell.commands` import it."""
