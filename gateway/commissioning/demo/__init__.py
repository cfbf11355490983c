"""The demonstration: a worn machine, a laser, the real gateway between them, and a screen."""
