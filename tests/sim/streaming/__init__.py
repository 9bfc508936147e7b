"""A made-up arm that streams over TCP: a user's driver (`tcp_arm.py`) and the controller that it speaks to."""
