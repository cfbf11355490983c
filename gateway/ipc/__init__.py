"""What the processes share: socket, messages, recordings."""
