"""Frames as they are on a serial line."""


def frame_of(wire: bytes) -> tuple[int, bytes]:
    """Return the unit id and the PDU of a frame."""
    return wire[0], wire[1:-2]
