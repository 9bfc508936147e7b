"""The phases that skills are made of."""
