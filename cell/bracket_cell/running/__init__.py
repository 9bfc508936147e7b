"""One tick: observe, judge, tick, act; nothing here outlives the loop."""
