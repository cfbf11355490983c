"""What the processes share: socket, messages, notes."""
