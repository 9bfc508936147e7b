"""The semantic planner: goal, next object and what remains to be done, from the assembly graph (section 3.1)."""
