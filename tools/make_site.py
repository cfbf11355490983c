"""Builds the documents as a site: ``python -m tools.make_site [FOLDER]``, or ``make site``.

FOLDER, ``build/site`` by itself, is replaced once everything is good; a warning of Sphinx is an error. What
is built how is said in ``tools/site/conf.py``. Addresses elsewhere are listed and not followed.
"""

import argparse
import re
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
NEEDED: Final = ("sphinx", "myst_parser", "furo")
MARK: Final = "searchindex.js"
"""Stands in every site."""
SPACE_MB: Final = 40
"""What the site and what Sphinx keeps beside it take of the disk, rounded up."""
_LINK: Final = re.compile(r'<a class="reference external" href="([^"]+)"')


def build(target: Path) -> int:
    """Build it; return the exit code of Sphinx, which has said what is wrong."""
    from sphinx.cmd.build import main as sphinx_build

    target.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=target.parent, prefix=".site-") as work:
        made, trees = Path(work, "site"), Path(work, "trees")
        code = sphinx_build(
            [
                *("-b", "html", "-W", "--keep-going", "-q"),
                *("-c", str(ROOT / "tools" / "site"), "-d", str(trees)),
                *(str(ROOT), str(made)),
            ]
        )
        if code == 0:
            shutil.rmtree(target, ignore_errors=True)
            made.rename(target)
    return code


def external_links(site: Path) -> list[str]:
    """Return the addresses elsewhere that the pages link to."""
    pages = (page.read_text(encoding="utf-8") for page in site.rglob("*.html"))
    return sorted({link for page in pages for link in _LINK.findall(page)})


def main() -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "build" / "site")
    target: Path = parser.parse_args().folder.resolve()
    if missing := [name for name in NEEDED if find_spec(name) is None]:
        sys.stderr.write(
            f"the site needs {' and '.join(missing)}, not installed here: where there is a network, "
            f"{sys.executable} -m pip install --editable '.[docs]'\n"
        )
        return 1
    if target.exists() and not (target / MARK).exists():
        sys.stderr.write(f"{target} is there and is no site: name a folder that can be made anew\n")
        return 1
    existing = next(folder for folder in target.parents if folder.exists())
    if (free := shutil.disk_usage(existing).free // 1_000_000) < SPACE_MB:
        sys.stderr.write(
            f"the disk is full: {existing} has {free} MB left and {SPACE_MB} MB are needed; make room\n"
        )
        return 1
    if code := build(target):
        sys.stderr.write(f"no site was built: mend what is named above; {target} is as it was\n")
        return code
    sys.stdout.write(f"{target / 'index.html'}\n")
    for link in external_links(target):
        sys.stdout.write(f"not followed: {link}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
