"""What programs read keeps its keys and the kinds of its values: documents, topics, metrics, messages."""

from tests.promises.shapes import FILE, shapes


def promised() -> dict[str, set[str]]:
    found = {}
    for line in FILE.read_text(encoding="utf-8").splitlines():
        path, _, kinds = line.partition(": ")
        found[path] = set(kinds.split(", ")) if kinds else set[str]()
    return found


def test_every_shape_that_was_promised_is_kept() -> None:
    before, now = promised(), shapes()
    gone = sorted(set(before) - set(now))
    assert not gone, f"these need an alias and a line in the CHANGELOG, or stay: {gone}"
    other = {path: kinds for path, kinds in now.items() if before.get(path) and not kinds <= before[path]}
    assert not other, f"other kinds of values than promised: {other}"
    new = sorted(set(now) - set(before))
    assert not new, f"python -m tests.promises.shapes writes these down: {new}"
