"""The table of attacks is that of the attacks that there are."""

import re

from tests.attacks.__main__ import DOCUMENT, PART, attacks

ROW = re.compile(r"^\| (.*?) \| (.*?) \| `(.*?)` \| [0-9.]+ \| [0-9.]+ \|$", re.MULTILINE)


def test_the_document_has_every_attack_and_no_other() -> None:
    found = PART.search(DOCUMENT.read_text())
    assert found is not None
    rows = ROW.findall(found[2])
    assert [(name, event) for name, _, event in rows] == [(each.name, each.event) for each in attacks()]
    assert all(got for _, got, _ in rows)
