"""What the processes share: socket, messages, log entries."""
