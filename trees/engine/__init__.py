"""The semantics of BehaviorTree.CPP 4 on py_trees: nodes, ports, scripts, blackboard; all of `trees` may import it."""
