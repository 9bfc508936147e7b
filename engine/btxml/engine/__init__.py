"""The semantics of BehaviorTree.CPP 4: nodes, ports, scripts, blackboard; all of `trees` may import it."""
