"""A page that is served is served whole."""

import re

import pytest

from gateway.supervisor import page
from tests.supervisor.page.stage import FOLDER

NEEDED = re.compile(r'from "\./([\w.]+)"|(?:src|href)="page/([\w.-]+)"')


def needed(name: str) -> set[str]:
    found = NEEDED.findall((FOLDER / name).read_text())
    return {script or linked for script, linked in found}


@pytest.mark.parametrize(
    ("begin", "served"), [("index.html", page.FILES), ("login.html", page.LOGIN_FILES)], ids=["page", "login"]
)
def test_all_that_a_page_needs_is_served_to_whoever_gets_it(begin: str, served: tuple[str, ...]) -> None:
    reached, to_do = {begin}, [begin]
    while to_do:
        for name in needed(to_do.pop()) - reached:
            assert name in served, name
            reached.add(name)
            to_do.append(name)
    assert len(reached) > 4
