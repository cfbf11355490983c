"""The time budget of a line, calculated from frames, wires and silences. Pure; no I/O, no clock."""
