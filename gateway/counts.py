"""Counts and raw values: whole where a register is, so that 64 bits lose nothing."""

Counts = int | float
"""A position on the scale of a drive. Never narrowed to ``float``: the compiled gateway (docs/decisions/0028)
would make it one."""
Raw = int | float
"""The content of a register: an ``int`` of every type but ``float32``. As ``Counts``."""
