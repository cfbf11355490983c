"""Simulated drives with real screws, a controller, a laser and a serial wire with a baud rate."""
