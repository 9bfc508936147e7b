"""What trainings share: loops, schedules, export, data sets of stills."""
