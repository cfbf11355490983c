"""Counts and raw values: integers where the register is an integer, so that 64 bits lose nothing."""

Counts = int | float
"""A position on the scale of a drive. Never narrow it to ``float``: the compiled gateway
(docs/decisions/0028) would then convert it."""
Raw = int | float
"""The content of a register: an ``int`` for every type but ``float32``. Otherwise as ``Counts``."""
