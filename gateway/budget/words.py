"""Spans in the words that people read."""

from collections.abc import Iterable

from gateway.times import NS_PER_MS, NS_PER_S


def ms(span_ns: int) -> str:
    """Write a span in milliseconds, with three figures but never more than µs.

    >>> ms(65_312_500), ms(1_750_000), ms(0), ms(112_458_333)
    ('65.3', '1.75', '0', '112')
    """
    span_ms = span_ns / NS_PER_MS
    if not span_ns:
        return "0"
    digits = 0 if span_ms >= 99.95 else 1 if span_ms >= 9.995 else 2 if span_ms >= 0.0995 else 3
    return f"{span_ms:.{digits}f}"


def sum_text(terms: Iterable[tuple[int, str]]) -> str:
    """Write the terms of a sum that are not 0.

    >>> sum_text([(46_979_167, "to the drive"), (0, "drive"), (9_166_667, "back")])
    '47.0 to the drive + 9.17 back'
    """
    return " + ".join(f"{ms(span_ns)} {what}" for span_ns, what in terms if span_ns)


def rate_text(round_ns: int) -> str:
    """Say how often a round comes: a round of more than a second by its seconds.

    >>> rate_text(242_000_000), rate_text(1_000_000_000), rate_text(1_250_000_000), rate_text(30_000_000_000)
    ('4.1 a second', '1.0 a second', 'one in 1.25 s', 'one in 30 s')
    """
    if round_ns <= NS_PER_S:
        return f"{NS_PER_S / round_ns:.1f} a second"
    round_s = round_ns / NS_PER_S
    digits = 0 if round_s >= 9.95 else 1 if round_s >= 1.995 else 2
    return f"one in {round_s:.{digits}f} s"
