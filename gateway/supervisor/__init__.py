"""Process 2: keeps the relay's tables up to date. The relay runs without it."""
