"""A measuring run: how an axis is driven to its targets, what is read there, and what becomes of it."""
