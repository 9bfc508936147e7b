"""Makes the parts of a controller from its configuration: nodes, services, detectors, reload."""
