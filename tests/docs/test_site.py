"""The documents as a site: every page has its place, and a reader needs nothing from elsewhere."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest

from tests.docs.pages import DOCS, ROOT
from tests.support.browser import started_browser
from tools.make_site import external_links
from tools.make_site import main as make_site_main

INDEX = DOCS / "index.md"
DECISIONS = DOCS / "decisions" / "index.md"
GROUPS = ("Tutorial", "How to", "Reference", "Explanation")
LOADED = re.compile(r"<(?:link|script|img|iframe|source)\b[^>]*?\b(?:href|src)=\"((?:https?:)?//[^\"]*)\"")
"""What a browser fetches by itself, from elsewhere."""


def make_site(
    *arguments: str, root: Path = ROOT, python: tuple[str, ...] = ()
) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, *python, "-m", "tools.make_site", *arguments],
        cwd=root, capture_output=True, text=True, timeout=250, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "site"
    done = make_site(str(folder))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[0] == str(folder / "index.html")
    assert list(folder.parent.iterdir()) == [folder]
    return folder


def listed(index: Path) -> list[Path]:
    links = re.findall(r"^- \[[^]]+\]\(([^)#]+\.md)\)", index.read_text(encoding="utf-8"), re.MULTILINE)
    return [(index.parent / link).resolve() for link in links]


def test_the_documents_are_grouped_by_what_their_reader_wants() -> None:
    text = INDEX.read_text(encoding="utf-8")
    assert tuple(re.findall(r"^## (.+)$", text, re.MULTILINE)) == GROUPS
    for group in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        assert re.search(r"^- \[", group, re.MULTILINE), group


def test_every_page_has_one_place() -> None:
    places = [*listed(INDEX), *listed(DECISIONS)]
    assert sorted(places) == sorted(set(places))
    pages = {path for path in DOCS.rglob("*.md") if path != INDEX}
    assert pages <= set(places), sorted(pages - set(places))


def test_the_site_is_built_without_a_warning_and_has_every_page(site: Path) -> None:
    for page in (INDEX, *listed(INDEX), *listed(DECISIONS)):
        html = (site / page.relative_to(ROOT)).with_suffix(".html").read_text(encoding="utf-8")
        assert len(re.findall(r"<h1>", html)) == 1, page
        for group in GROUPS:
            assert f'<span class="caption-text">{group}</span>' in html
    assert 'url=docs/index.html"' in (site / "index.html").read_text(encoding="utf-8")


def test_every_word_can_be_searched_for(site: Path) -> None:
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert index.startswith("Search.setIndex(")
    for word in ("leadscrew", "backlash", "watchdog"):
        assert word in index


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 45
    for page in pages:
        assert LOADED.findall(page.read_text(encoding="utf-8")) == [], page
    for sheet in site.rglob("*.css"):
        assert not re.search(r"@import|url\(\s*[\"']?(?:https?:)?//", sheet.read_text(encoding="utf-8")), (
            sheet
        )


def test_a_browser_reads_and_searches_it_without_a_server_and_asks_nobody(site: Path) -> None:
    asked: list[str] = []
    with started_browser() as browser:
        page = browser.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.goto((site / "index.html").as_uri())
        page.wait_for_url("**/docs/index.html", wait_until="commit")
        page.get_by_role("link", name="The first hour").first.click()
        page.wait_for_url("**/docs/first-hour.html", wait_until="commit")
        page.goto(f"{(site / 'search.html').as_uri()}?q=backlash")
        page.wait_for_selector("#search-results .search-summary >> text=/Search finished/")
        found = page.locator("#search-results li a").all_inner_texts()
    assert len(found) > 10
    assert "Configuration" in found
    assert len(asked) > 20
    assert [url for url in asked if not url.startswith((site.as_uri(), "data:"))] == []


def test_addresses_elsewhere_are_whole_and_encrypted(site: Path) -> None:
    """Nobody follows them: a machine without a network builds the site too."""
    links = external_links(site)
    assert "https://keepachangelog.com/en/1.1.0/" in links
    for link in links:
        address = urlsplit(link)
        assert address.scheme == "https" or address.hostname == "127.0.0.1", link
        assert "." in (address.hostname or ""), link


def small(folder: Path, page: str) -> Path:
    """Return a repository with one page."""
    needed = ("gateway/__init__.py", "gateway/supervisor/page/icon.svg", "tools/make_site.py")
    for path in (*needed, "tools/site/conf.py", "tools/site/static/site.css"):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, folder / path)
    (folder / "docs").mkdir()
    (folder / "docs" / "index.md").write_text("# Small\n\n## Tutorial\n\n- [One](one.md)\n", encoding="utf-8")
    (folder / "docs" / "one.md").write_text(page, encoding="utf-8")
    return folder


def test_a_link_that_leads_nowhere_is_named_and_the_site_stays_as_it_was(tmp_path: Path) -> None:
    root = small(tmp_path, "# One\n\nSee [two](two.md) and [there](index.md#nowhere).\n")
    before = root / "build" / "site" / "searchindex.js"
    before.parent.mkdir(parents=True)
    before.write_text("before", encoding="utf-8")
    done = make_site(root=root)
    assert done.returncode == 1
    assert f"{root}/docs/one.md:3: WARNING: 'myst' cross-reference target not found: 'two.md'" in done.stderr
    assert f"{root}/docs/one.md:3: WARNING: local id not found in doc 'docs/index': 'nowhere'" in done.stderr
    assert done.stderr.endswith(
        f"no site was built: mend what is named above; {before.parent} is as it was\n"
    )
    assert [path.name for path in before.parent.parent.rglob("*")] == ["site", "searchindex.js"]
    assert before.read_text(encoding="utf-8") == "before"


def test_without_its_programs_it_says_what_to_install(tmp_path: Path) -> None:
    done = make_site(str(tmp_path / "site"), python=("-S",))
    assert done.returncode == 1
    assert done.stderr == (
        "the site needs sphinx and myst_parser and furo, not installed here: where there is a network, "
        f"{sys.executable} -m pip install --editable '.[docs]'\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_named_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=39_999_999))
    monkeypatch.setattr(sys, "argv", ["make_site", str(tmp_path / "build" / "site")])
    assert make_site_main() == 1
    said = f"the disk is full: {tmp_path} has 39 MB left and 40 MB are needed; make room\n"
    assert capsys.readouterr().err == said
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear", encoding="utf-8")
    done = make_site(str(tmp_path))
    assert done.returncode == 1
    assert done.stderr == f"{tmp_path} is there and is no site: name a folder that can be made anew\n"
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]
