"""Read-only checks of real drives: what is read, its meaning, and what is wrong."""
