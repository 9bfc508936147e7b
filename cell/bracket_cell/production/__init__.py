"""The book of production: what was made, by whom, for which order, and how well the time was used."""
