"""Who takes what sensors say over MQTT."""

from typing import Protocol


class Hear(Protocol):
    """Takes a message of a sensor; does not block."""

    def __call__(self, topic: str, payload: bytes, *, is_retained: bool) -> None:
        """Take it."""
        ...


def hear_nothing(topic: str, payload: bytes, *, is_retained: bool) -> None:
    """Take a message and forget it."""
