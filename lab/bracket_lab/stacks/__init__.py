"""Everyday objects in stacks on a table: what they are made of, how they come to rest, which rests on which."""
