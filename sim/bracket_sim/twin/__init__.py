"""The twin: the simulated cell on the wall's time, served by the wires of real devices."""
