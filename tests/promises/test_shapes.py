"""What programs read keeps its keys and the kinds of its values: documents, topics, metrics, messages."""

from tests.promises.listing import Listed, listed_in
from tests.promises.shapes import FILE, listed, shapes


def kinds_of(each: Listed) -> dict[tuple[str, str], set[str]]:
    split = ((heading, item.split()) for heading, item in each)
    return {(heading, name): set(kinds) for heading, (name, *kinds) in split}


def test_every_shape_that_was_promised_is_kept() -> None:
    before, now = kinds_of(listed_in(FILE.read_text(encoding="utf-8"))), kinds_of(listed(shapes()))
    gone = sorted(set(before) - set(now))
    assert not gone, f"these need an alias and a line in the CHANGELOG, or stay: {gone}"
    other = {path: kinds for path, kinds in now.items() if before.get(path) and not kinds <= before[path]}
    assert not other, f"other kinds of values than promised: {other}"
    new = sorted(set(now) - set(before))
    assert not new, f"python -m tests.promises.shapes writes these down: {new}"
