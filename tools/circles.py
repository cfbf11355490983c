"""Names the modules that import each other in a circle (make check).

Every import that is written counts, also under TYPE_CHECKING and inside a function: whoever reads one of the
modules needs the others. import-linter has acyclic_siblings (2.17), which does not see a circle of a module
and the package that it lies in.

Exit codes: 0 there is none; 1 there are some, each told with one chain of imports.
"""

import ast
import sys
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

Imports = Mapping[str, Mapping[str, str]]
"""Of each module what it imports, each with the file and the line where it first does."""


def read_imports(package: Path) -> Imports:
    """Return what the modules of a package import of one another."""
    files = {_name(path.relative_to(package.parent)): path for path in sorted(package.rglob("*.py"))}
    imports: dict[str, dict[str, str]] = {module: {} for module in files}
    for module, path in files.items():
        for line, name in sorted(_imported(ast.parse(path.read_bytes()))):
            # What is imported of a module is either a module in it, or something that it has.
            target = name if name in files else name.rpartition(".")[0]
            if target in files and target != module:
                imports[module].setdefault(target, f"{path.relative_to(package.parent)}:{line}")
    return imports


def circles(imports: Imports) -> list[list[str]]:
    """Return of each circle the shortest chain that begins and ends with its first module."""
    found = []
    told: set[str] = set()
    for module in sorted(imports):
        ways = _ways(module, imports)
        if module in ways and module not in told:
            told |= {other for other in ways if module in _ways(other, imports)}
            chain = [ways[module], module]
            while chain[0] != module:
                chain.insert(0, ways[chain[0]])
            found.append(chain)
    return found


def _name(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(tree: ast.Module) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):  # ruff bans those that are relative
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


def _ways(start: str, imports: Imports) -> dict[str, str]:
    """Return all that is reached from a module, each with the one before it on the shortest way."""
    ways: dict[str, str] = {}
    ends = [start]
    for end in ends:
        for target in imports[end]:
            if target not in ways:
                ways[target] = end
                ends.append(target)
    return ways


def main(package: Path = ROOT / "gateway") -> int:
    """Look, and say what was found."""
    imports = read_imports(package)
    found = circles(imports)
    for chain in found:
        print(" -> ".join(chain))
        for importer, imported in pairwise(chain):
            print(f"  {imports[importer][imported]} imports {imported}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
