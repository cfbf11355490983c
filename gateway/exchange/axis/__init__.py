"""One axis: its state, what can happen to it, its registers, its record."""
