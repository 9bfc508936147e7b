"""Tree files in BehaviorTree.CPP v4 XML, the engine that runs them on py_trees, and the node library."""
