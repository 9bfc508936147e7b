"""What every device of a protocol must do, whatever is behind it: simulated, recorded, or a twin's wires.

`pytest -m contract` runs them all without hardware.
"""
