"""What is fuzzed. A new target is a function, its seeds, and one entry in :data:`TARGETS`."""

import ast
import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.fuzz import configuration, exchange, http_requests, mbap, mqtt_messages, readings, rtu, tables

FOLDER: Final = Path(__file__).parent
CORPUS: Final = FOLDER / "corpus"
"""``TARGET.txt``: inputs that reach what the seeds do not, one a line, as literals of Python."""
CRASHES: Final = FOLDER / "crashes"
"""``TARGET/…``: inputs that once broke a rule."""


def no_words() -> Iterable[bytes]:
    """Return none: the bytes have no words."""
    return ()


@dataclass(frozen=True, slots=True)
class Target:
    """One function that no input may have raise anything."""

    run: Callable[[bytes], None]
    seeds: Callable[[], Iterable[bytes]]
    """What the fuzzer begins with: frames and files that the tests and the examples have."""
    longest: int
    """Bytes of an input at most: a few times that of a seed."""
    words: Callable[[], Iterable[bytes]] = no_words
    """What stands in good inputs, as a dictionary for the fuzzer."""


TARGETS: Final[dict[str, Target]] = {
    "rtu-requests": Target(rtu.requests, rtu.request_seeds, 1024),
    "rtu-replies": Target(rtu.replies, rtu.reply_seeds, 1024),
    "mbap": Target(mbap.streams, mbap.seeds, 1024),
    "exchange": Target(exchange.traffic, exchange.seeds, 2048),
    "readings": Target(readings.files, readings.seeds, 6144),
    "configuration": Target(configuration.files, configuration.seeds, 24_576, configuration.words),
    "mqtt": Target(mqtt_messages.messages, mqtt_messages.seeds, 2048, mqtt_messages.words),
    "http": Target(http_requests.requests, http_requests.seeds, 4096, http_requests.words),
    **{f"tables-{name}": Target(*tables.target_of(name), 4096) for name in tables.DIALECT_NAMES},
}


def name_of(data: bytes) -> str:
    """Return what libFuzzer calls an input."""
    return hashlib.sha1(data, usedforsecurity=False).hexdigest()


def corpus(name: str) -> dict[str, bytes]:
    """Return what is kept for a target, by the names of the inputs and in their order."""
    file = CORPUS / f"{name}.txt"
    lines = file.read_text(encoding="ascii").splitlines() if file.exists() else ()
    return dict(sorted((name_of(data), data) for data in map(ast.literal_eval, lines)))


def keep(name: str, inputs: Iterable[bytes]) -> None:
    """Keep these inputs for a target, and no others."""
    lines = "".join(f"{data!r}\n" for data in sorted(inputs))
    (CORPUS / f"{name}.txt").write_text(lines, encoding="ascii")


def crashes(name: str) -> dict[str, bytes]:
    """Return the inputs with which a target once broke a rule, by the names of their files."""
    return {path.name: path.read_bytes() for path in sorted((CRASHES / name).glob("*"))}
