"""The simulated world in a process of its own, and the devices that speak to it."""
