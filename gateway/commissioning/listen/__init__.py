"""``listen``: passive monitoring of a line; it never sends."""
