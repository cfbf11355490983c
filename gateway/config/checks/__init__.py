"""Checks of a configuration beyond types and bounds: six files, by subject."""
