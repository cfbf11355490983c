"""Pure maths: correction table, interpolation, exact inverse, direction, reversal blend, one axis.

Nothing here imports asyncio, time, logging or sockets: time is an argument. The sign is defined once:
``corrected = nominal + correction``.
"""
