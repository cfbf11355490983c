"""What users rely on by name stays: keys, codes, registers, commands, options, drives and table formats."""

from tests.promises.promises import FILE, promises


def test_what_was_promised_is_kept() -> None:
    promised, kept = FILE.read_text(encoding="utf-8").splitlines(), promises()
    gone = sorted(set(promised) - set(kept))
    assert not gone, f"these need an alias and a line in the CHANGELOG, or stay: {gone}"


def test_what_is_new_is_promised_too() -> None:
    new = sorted(set(promises()) - set(FILE.read_text(encoding="utf-8").splitlines()))
    assert not new, f"python -m tests.promises.promises writes these down: {new}"
