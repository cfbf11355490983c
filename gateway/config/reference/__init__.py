"""The reference of the configuration: every key with its type, bounds, default and meaning."""
