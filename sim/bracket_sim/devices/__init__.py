"""The simulated devices, behind the device protocols."""
