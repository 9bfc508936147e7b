"""Tells people what a log holds: summary, report, queries, exports; `training` may import it."""
