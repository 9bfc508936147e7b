"""Nodes by the names and ports that people know from Nav2 and MoveIt Pro, in the terms of this cell."""
