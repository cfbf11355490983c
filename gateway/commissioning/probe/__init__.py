"""A read-only look at real drives: what is read, what it means, what is wrong with it."""
