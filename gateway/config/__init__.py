"""Reads ``gateway.toml`` into frozen, checked objects.

Each error names file, key, value and what is allowed.
"""
