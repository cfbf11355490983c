"""One axis: its state machines, its registers and its record."""
