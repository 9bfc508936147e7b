"""Types, errors, clock and device protocols; every package may import it, and it imports none of them."""
