"""The simulated world in a process of its own: it outlives the controller, which reaches it by a local socket."""
