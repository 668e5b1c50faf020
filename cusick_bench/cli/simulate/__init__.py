"""Commands that simulate, and that measure the simulator."""
