"""Pure maths: laser readings to tables."""
