"""Shows trees: text, picture, palette, Groot2's messages; `cell` imports it."""
