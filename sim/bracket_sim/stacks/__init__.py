"""Objects in stacks: their shapes, settings and how they are heaped."""
