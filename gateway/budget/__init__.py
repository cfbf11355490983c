"""What a line can hold, by arithmetic: frames, wires, silences. Pure; no I/O, no clock."""
