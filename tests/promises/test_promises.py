"""What users rely on by name stays: keys, codes, registers, commands, options, drives and table formats."""

from tests.promises.listing import listed_in
from tests.promises.promises import FILE, promises


def test_what_was_promised_is_kept() -> None:
    gone = sorted(listed_in(FILE.read_text(encoding="utf-8")) - promises())
    assert not gone, f"these need an alias and a line in the CHANGELOG, or stay: {gone}"


def test_what_is_new_is_promised_too() -> None:
    new = sorted(promises() - listed_in(FILE.read_text(encoding="utf-8")))
    assert not new, f"python -m tests.promises.promises writes these down: {new}"
