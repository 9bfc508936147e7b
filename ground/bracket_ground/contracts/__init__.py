"""What every device of a protocol must do, whatever is behind it: simulated, recorded, or a twin's wires.

Each module has `CHECKS`, functions of a `Bench` that raise AssertionError: call them from any test of a driver. They
need nothing but this distribution.
"""
