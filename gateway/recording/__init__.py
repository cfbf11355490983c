"""Recordings: what crosses the border of a line, kept in a file or in memory, read and replayed."""
