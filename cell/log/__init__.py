"""Reading, replaying, comparing and questioning logs."""
