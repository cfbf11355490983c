"""The frames that the tests have, as seeds: those of the manuals."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Final

FRAMES: Final = Path(__file__).parents[1] / "data" / "golden_frames.toml"


@cache
def golden_frames() -> tuple[tuple[bytes, bytes], ...]:
    """Return request and reply of each exchange, as on the wire; empty where the manual has only one."""
    document = tomllib.loads(FRAMES.read_text(encoding="utf-8"))
    return tuple(
        (bytes.fromhex(frame.get("request", "")), bytes.fromhex(frame.get("reply", "")))
        for frame in document["frame"]
    )


def stood_in(stream: bytes, frames: list[bytes]) -> bool:
    """Whether the frames stand in the stream whole, in this order, none in another."""
    at = 0
    for frame in frames:
        at = stream.find(frame, at)
        if at < 0:
            return False
        at += len(frame)
    return True
