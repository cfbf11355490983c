"""A wire of the bench tells a pause inside of a frame from the silence between two."""

from bench.wire import HeardWire
from gateway.transport.endpoints import SerialEndpoint

CHAR_NS = 1_041_667  # ten bits at 9 600 baud


def test_what_comes_after_the_wire_was_empty_counts_until_it_is_a_silence() -> None:
    wire = HeardWire(SerialEndpoint("wire", 9600))
    wire.send(b"abcd", 0)
    wire.send(b"ef", 3 * CHAR_NS)  # while it is busy, until 6 characters have passed
    assert (wire.pauses, wire.longest_ns) == (0, 0)
    wire.send(b"g", 6_250_000 + 300_000)
    assert (wire.pauses, wire.longest_ns) == (1, 300_000)
    # 3.5 characters are 3.646 ms; half of them stand between two frames.
    wire.send(b"h", 6_550_000 + 1_041_667 + 1_900_000)
    assert (wire.pauses, wire.longest_ns) == (1, 300_000)
