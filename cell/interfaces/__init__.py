"""Types, errors, clock and device protocols that every package shares; it imports none of them."""
