"""The demonstration: a worn machine, a laser, the real gateway in between, and a screen to look at."""
