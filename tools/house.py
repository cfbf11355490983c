"""Shows how large the program is, and how many parts it has: ``make house``, ``python -m tools.house``.

One table for the checkout, or for two revisions side by side: ``python -m tools.house 1a2b3c main``. It
forbids nothing, and no figure is a goal: CONTRIBUTING.md says how to read them. ``--walks`` adds what the
running program does for a position command and for the reload of a table (:mod:`tools.walks`).

Exit codes: 0 the table is printed; 1 git does not know a revision.
"""

import argparse
import ast
import io
import re
import shutil
import subprocess
import sys
import tarfile
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from tools.circles import read_imports

ROOT: Final = Path(__file__).resolve().parent.parent
GIT: Final = shutil.which("git") or "git"
SHORT_LINES: Final = 70
"""A file of fewer lines is a short one."""
RECORD_BASES: Final = frozenset({"NamedTuple", "Struct"})
NOT_CODE: Final = frozenset(
    {
        tokenize.COMMENT,
        tokenize.DEDENT,
        tokenize.ENCODING,
        tokenize.ENDMARKER,
        tokenize.INDENT,
        tokenize.NEWLINE,
        tokenize.NL,
    }
)
HOUSE_WORDS: Final = frozenset(
    re.findall(
        r"\w+",
        """
        apart aside beam blind book chronicle cut cutter deed desk door doubt ear entrance fate
        feeds front guest happening hear heart hunts ink keep keeper keeping known lead look lump
        manners meaning mend note overhear owe place places recalled restage retained rivals said
        say saying sheet sight spoilt standing stands stillness story strangers tally tape tell told
        torn trouble turn turned unproven untold wanted whereabouts wish
        """,
    )
)
"""Words that once had a meaning of their own here; the words of the field have replaced them in the code."""
IDIOMS: Final = (
    "nobody",
    "whoever",
    "somebody",
    "stands",
    "at once",
    "of its own",
    "is told",
    "has to be",
    "by itself",
)
"""Turns of phrase over which a technician stumbles."""
_PARTS: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_SEE: Final = re.compile(r"See .+\.")

Figures = dict[str, int]
"""What is counted, by what it is called; the order is that of the table."""


class _Module:
    """A source file, read."""

    def __init__(self, path: Path) -> None:
        self.text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text)
        self.lines = self.text.count("\n")
        self.nodes = list(ast.walk(self.tree))
        self.classes = [node for node in self.nodes if isinstance(node, ast.ClassDef)]
        self.texts = [found for node in self.nodes if (found := _text(node)) is not None]
        self.docstrings = [found for node in self.nodes if (found := _docstring(node)) is not None]


def _docstring(node: ast.AST) -> ast.Constant | None:
    if (
        not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        or not node.body
    ):
        return None
    return _text(node.body[0])


def _text(node: ast.AST) -> ast.Constant | None:
    """Return a string that stands alone: a docstring, or the one below an attribute."""
    if (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ):
        return node.value
    return None


def _code_lines(module: _Module) -> int:
    """Return how many lines hold code: neither blank, nor comment, nor docstring."""
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(module.text).readline):
        if token.type not in NOT_CODE:
            held.update(range(token.start[0], token.end[0] + 1))
    for text in module.texts:
        held.difference_update(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return len(held)


def _statements(module: _Module) -> int:
    imports = sum(isinstance(node, ast.Import | ast.ImportFrom) for node in module.nodes)
    return sum(isinstance(node, ast.stmt) for node in module.nodes) - len(module.texts) - imports


def _name_of(node: ast.expr) -> str:
    if isinstance(node, ast.Call | ast.Subscript):
        return _name_of(node.func if isinstance(node, ast.Call) else node.value)
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _record_types(classes: Iterable[ast.ClassDef]) -> int:
    """Return how many classes are records: dataclasses, named tuples, structs and what is made of these."""
    known = list(classes)
    names = set(RECORD_BASES)
    while True:
        found = {each.name for each in known if _is_record(each, names)}
        if found <= names:
            return sum(_is_record(each, names) for each in known)
        names |= found


def _is_record(node: ast.ClassDef, names: set[str]) -> bool:
    is_dataclass = any(_name_of(each) == "dataclass" for each in node.decorator_list)
    return is_dataclass or any(_name_of(base) in names and _name_of(base) != "" for base in node.bases)


def _is_delegation(node: ast.AST) -> bool:
    """Whether a function does nothing but hand its own arguments on."""
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return False
    body = node.body[1:] if _docstring(node) is not None else node.body
    if len(body) != 1 or not isinstance(body[0], ast.Return | ast.Expr):
        return False
    value = body[0].value
    call = value.value if isinstance(value, ast.Await) else value
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
        return False
    given = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    handed = [*call.args, *(each.value for each in call.keywords)]
    names = [each.id for each in handed if isinstance(each, ast.Name)]
    is_own = given[:1] == ["self"] and isinstance(call.func.value, ast.Attribute)
    return is_own and len(names) == len(handed) and names == given[1:]


def _words_of(names: Iterable[str]) -> int:
    return sum(part.lower() in HOUSE_WORDS for name in names for part in _PARTS.findall(name))


def _identifiers(module: _Module) -> Iterator[str]:
    for node in module.nodes:
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name


def _prose_words(texts: Iterable[str]) -> int:
    return sum(word.lower() in HOUSE_WORDS for text in texts for word in re.findall(r"[A-Za-z]+", text))


def _length(page: str) -> int:
    """Return how many words a page has; bars of its tables, rules and dashes are none."""
    return sum(re.search(r"\w", word) is not None for word in page.split())


def _idioms(texts: Iterable[str]) -> int:
    joined = "\n".join(texts).lower()
    return sum(len(re.findall(rf"\b{re.escape(idiom)}\b", joined)) for idiom in IDIOMS)


def figures_of(root: Path) -> Figures:
    """Count what a checkout holds."""
    modules = [_Module(path) for path in sorted((root / "gateway").rglob("*.py"))]
    classes = [each for module in modules for each in module.classes]
    public = Counter(
        each.name for module in modules for each in module.tree.body if isinstance(each, ast.ClassDef)
    )
    imports = read_imports(root / "gateway")
    importers = Counter(target for targets in imports.values() for target in targets)
    strings = [
        node.value
        for module in modules
        for node in module.nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    pages = [path.read_text(encoding="utf-8") for path in _pages(root)]
    decisions = [path.read_text(encoding="utf-8") for path in sorted((root / "docs/decisions").glob("*.md"))]
    tests = sorted((root / "tests").rglob("*.py"))
    return {
        "files": len(modules),
        "lines": sum(module.lines for module in modules),
        "code lines": sum(_code_lines(module) for module in modules),
        "statements": sum(_statements(module) for module in modules),
        f"files under {SHORT_LINES} lines": sum(module.lines < SHORT_LINES for module in modules),
        "modules with one importer": sum(importers[name] == 1 for name in imports),
        "classes": len(classes),
        "record types": _record_types(classes),
        "enums": sum(any(_name_of(b).endswith(("Enum", "Flag")) for b in each.bases) for each in classes),
        "protocols": sum(any(_name_of(base) == "Protocol" for base in each.bases) for each in classes),
        "public class names used twice": sum(n > 1 for name, n in public.items() if not name.startswith("_")),
        "pure delegations": sum(_is_delegation(node) for module in modules for node in module.nodes),
        '"See X" docstrings': sum(
            _SEE.fullmatch(str(text.value).strip()) is not None
            for module in modules
            for text in module.docstrings
        ),
        "dict[str, Any]": sum(module.text.count("dict[str, Any]") for module in modules),
        "house words in identifiers": _words_of(name for module in modules for name in _identifiers(module)),
        "house words in strings": _prose_words(strings),
        "house words in pages": _prose_words(pages),
        "idioms in strings and pages": _idioms([*strings, *pages]),
        "words in pages": sum(map(_length, pages)),
        "words in decisions": sum(map(_length, decisions)),
        "files of tests": len(tests),
        "lines of tests": sum(path.read_text(encoding="utf-8").count("\n") for path in tests),
        "lines of tools": sum(
            path.read_text(encoding="utf-8").count("\n") for path in (root / "tools").rglob("*.py")
        ),
    }


def _pages(root: Path) -> list[Path]:
    return [*sorted(root.glob("*.md")), *sorted((root / "docs").glob("*.md"))]


def table(columns: Sequence[tuple[str, Figures]]) -> Iterator[str]:
    """Yield the table, line by line: a column for each revision, and of two what has changed."""
    rows = list(dict.fromkeys(name for _, figures in columns for name in figures))
    yield f"{'':<44}" + "".join(f"{title[:12]:>13}" for title, _ in columns)
    for name in rows:
        values = [figures.get(name) for _, figures in columns]
        line = f"{name:<44}" + "".join(
            f"{'-' if value is None else format(value, ',')!s:>13}" for value in values
        )
        if len(values) == 2 and None not in values:
            line += f"{int(values[1] or 0) - int(values[0] or 0):>+10,}"
        yield line


def _measured(root: Path, *, walks: bool) -> Figures:
    figures = figures_of(root)
    if walks:
        from tools.walks import walks_of

        figures |= walks_of(root)
    return figures


def main() -> int:
    """Print the table of the checkout, or of revisions."""
    arguments = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    arguments.add_argument("revisions", nargs="*", help="what git knows; without one: the checkout as it is")
    arguments.add_argument("--walks", action="store_true", help="count the calls of the running program, too")
    given = arguments.parse_args()
    columns = []
    for revision in given.revisions:
        with TemporaryDirectory() as folder:
            archived = subprocess.run([GIT, "archive", revision], cwd=ROOT, capture_output=True, check=False)
            if archived.returncode:
                sys.stderr.write(f"{revision}: {archived.stderr.decode().strip()}\n")
                return 1
            with tarfile.open(fileobj=io.BytesIO(archived.stdout)) as archive:
                archive.extractall(folder, filter="data")
            columns.append((revision, _measured(Path(folder), walks=given.walks)))
    if not columns:
        columns.append(("here", _measured(ROOT, walks=given.walks)))
    for line in table(columns):
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
