"""``gateway.toml`` to frozen, checked objects; every error names file, key, value and what is allowed."""
