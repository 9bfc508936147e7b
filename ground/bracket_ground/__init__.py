"""What cells, simulators and drivers share: types, protocols of devices and planners, units, files and errors."""
