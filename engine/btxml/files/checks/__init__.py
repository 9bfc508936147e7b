"""Everything that can be wrong with a tree before it runs."""
