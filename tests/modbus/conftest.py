"""Frames from the manuals, read from a data file that other tests share."""

import tomllib
from pathlib import Path

import pytest

FRAMES = Path(__file__).parent.parent / "data" / "golden_frames.toml"
DOCUMENT = tomllib.loads(FRAMES.read_text(encoding="utf-8"))
REQUESTS = [frame for frame in DOCUMENT["frame"] if "request" in frame]
REPLIES = [frame for frame in DOCUMENT["frame"] if "reply" in frame]


def _name(frame: dict[str, str]) -> str:
    return frame["name"].replace(" ", "-")


@pytest.fixture(params=REQUESTS, ids=_name)
def golden_request(request: pytest.FixtureRequest) -> bytes:
    """One request as on the wire."""
    return bytes.fromhex(request.param["request"])


@pytest.fixture(params=REPLIES, ids=_name)
def golden_exchange(request: pytest.FixtureRequest) -> tuple[bytes, bytes]:
    """The PDU of a request and the reply as on the wire.

    Where the manual prints only the reply, a request of the function code that it answers stands in.
    """
    reply = bytes.fromhex(request.param["reply"])
    if "request" in request.param:
        return bytes.fromhex(request.param["request"])[1:-2], reply
    return bytes((reply[1] & 0x7F, 0, 0, 0, 1)), reply


@pytest.fixture(params=DOCUMENT["bad"], ids=_name)
def misprint(request: pytest.FixtureRequest) -> tuple[bytes, bytes]:
    """A frame with a wrong check sum, and the same with the right one."""
    return bytes.fromhex(request.param["frame"]), bytes.fromhex(request.param["intact"])


@pytest.fixture
def golden_requests() -> list[bytes]:
    """All requests as on the wire."""
    return [bytes.fromhex(frame["request"]) for frame in REQUESTS]
