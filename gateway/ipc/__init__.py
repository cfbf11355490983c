"""What is handed from the configuration to the relay."""
