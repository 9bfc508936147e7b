"""What a plant's other systems read of a run, and what they order."""
