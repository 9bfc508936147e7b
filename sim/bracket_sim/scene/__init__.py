"""What stands in the world and how it looks; no time passes here."""
