"""The part of debian/copyright about the packages that the Debian package brings (deploy/debian/rules).

python3 tools/bundled_licences.py SITE-PACKAGES  prints a paragraph for each, after the format of Debian:
its files, who holds the rights, the name of its licence, and the texts that lie beside it.
"""

import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Final

INSTALLED: Final = "opt/pitch-gateway/lib/python3.*/site-packages"
LICENCE: Final = re.compile(r"(?:licen[cs]e|copying|notice)", re.IGNORECASE)
HOLDER: Final = re.compile(r"^\W*(copyright\s+(?:\(c\)|©|\d{4}).*)$", re.IGNORECASE | re.MULTILINE)
OURS: Final = "pitch-gateway"


def paragraph(package: Distribution) -> str:
    """Return the paragraph of one package.

    Raises:
        ValueError: neither its metadata nor a file of it says what its licence is.
    """
    about = package.metadata
    name = about["Name"]
    files = package.files or []
    texts = [each.read_text() for each in files if LICENCE.match(each.name) and ".dist-info" in str(each)]
    classifiers = about.get_all("Classifier") or []
    kinds = [each.rpartition(" :: ")[2] for each in classifiers if each.startswith("License ::")]
    first_line = said(package, "License").partition("\n")[0]
    licence = said(package, "License-Expression") or ", ".join(kinds) or first_line
    if not licence and not texts:
        raise ValueError(f"{name} {package.version} says nowhere what its licence is: ask who wrote it")
    holders = dict.fromkeys(found.strip() for text in texts for found in HOLDER.findall(text))
    author = said(package, "Author") or said(package, "Author-email") or f"the authors of {name}"
    roots = sorted({each.parts[0] for each in files} - {"..", "__pycache__"})
    return "\n".join(
        [
            field("Files", [f"{INSTALLED}/{root}{'' if root.endswith('.py') else '/*'}" for root in roots]),
            field("Copyright", list(holders) or [author]),
            f"License: {name}-{package.version}",
            *indented(f"{licence or 'see below'}\n\n" + "\n\n".join(texts)),
        ]
    )


def said(package: Distribution, key: str) -> str:
    """Return what the metadata say; empty where they do not."""
    return package.metadata[key] if key in package.metadata else ""  # noqa: SIM401 - its type has no get


def field(name: str, lines: list[str]) -> str:
    """Return a field whose values stand below each other."""
    return f"{name}: " + "\n ".join(lines)


def indented(text: str) -> Iterator[str]:
    """Yield a text as a field goes on: one blank in front, and a point where a line is empty."""
    for line in text.rstrip().splitlines():
        yield f" {line.rstrip()}" if line.strip() else " ."


def main(folder: Path) -> None:
    """Print all of them but our own."""
    found = {each.metadata["Name"].lower(): each for each in distributions(path=[str(folder)])}
    for name in sorted(found.keys() - {OURS}):
        print(f"\n{paragraph(found[name])}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
