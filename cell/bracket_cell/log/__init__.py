"""What is done with logs."""
