"""Cut-through forwarding on serial lines: a frame is sent on before all of it has come in."""
