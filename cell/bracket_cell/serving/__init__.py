"""The cell that is served: a page that outlives runs, and the processes of the runs that it begins."""
