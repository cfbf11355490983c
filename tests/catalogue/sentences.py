"""Sentences in the sources of the gateway, with … for what is filled in."""

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from string import Formatter

from gateway.catalogue import starts
from gateway.catalogue.entry import StartEntry

PACKAGE = Path(__file__).parents[2] / "gateway"


def trees(*folders: str) -> list[ast.Module]:
    """Return the modules of these folders or files of the package."""
    paths = [path for name in folders for path in sorted(PACKAGE.glob(f"{name}/**/*.py"))]
    paths += [PACKAGE / name for name in folders if name.endswith(".py")]
    assert paths
    return [ast.parse(path.read_text()) for path in paths]


Functions = dict[str, list[ast.FunctionDef]]
"""Those of the modules that are looked at, by their names."""


def said(node: ast.expr | None, function: ast.AST | None, functions: Functions) -> Iterator[str]:
    """Yield every sentence that an expression may be; a name is looked up in its function.

    What a call of a function of ours returns is followed; ``str(error)`` is the sentence of another raise.
    """
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value:
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        yield "".join(_part(part, function, functions) for part in node.values)
    elif isinstance(node, ast.Tuple):  # what was found, and what to do
        yield from said(node.elts[0], function, functions)
    elif (entry := _of_catalogue(node)) is not None:
        yield entry.says
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "join":
        yield from said(node.args[0], function, functions)
    elif isinstance(node, ast.Name) and function is not None:
        for inside in ast.walk(function):
            is_it = isinstance(inside, ast.Assign) and getattr(inside.targets[0], "id", "") == node.id
            if isinstance(inside, ast.Assign) and is_it and node.id not in _names(inside.value):
                yield from said(inside.value, function, functions)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id != "str":
        for called in functions.get(node.func.id, []):
            yield from returned(called, functions)


def _of_catalogue(node: ast.expr | None) -> StartEntry | None:
    """Return the entry whose beginning is filled in here; None: none is."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "begin":
        named = node.func.value
        if isinstance(named, ast.Attribute) and getattr(named.value, "id", "") == "starts":
            entry: StartEntry = getattr(starts, named.attr)
            fields = {field for _, field, _, _ in Formatter().parse(entry.begins) if field}
            assert {keyword.arg for keyword in node.keywords} == fields, named.attr
            return entry
    return None


def _names(node: ast.AST) -> set[str]:
    return {inside.id for inside in ast.walk(node) if isinstance(inside, ast.Name)}


def _part(part: ast.expr, function: ast.AST | None, functions: Functions) -> str:
    """Return a part of a sentence; … for what is filled in, but where it is always the same sentence."""
    if isinstance(part, ast.FormattedValue):
        inside = sorted(set(said(part.value, function, functions)))
        return inside[0] if len(inside) == 1 else "…"
    return str(part.value) if isinstance(part, ast.Constant) else "…"


def returned(function: ast.AST, functions: Functions) -> Iterator[str]:
    """Yield the sentences that a function may return."""
    for inside in ast.walk(function):
        if isinstance(inside, ast.Return):
            yield from said(inside.value, function, functions)


def raised(modules: Iterable[ast.AST], classes: frozenset[str], argument: int) -> set[str]:
    """Return the sentences with which these classes are made; ``argument`` is the place of the sentence."""
    everything = [node for module in modules for node in ast.walk(module)]
    functions: Functions = {}
    for node in everything:
        if isinstance(node, ast.FunctionDef):
            functions.setdefault(node.name, []).append(node)
    found: set[str] = set()
    for function in everything:
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for call in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
                name = call.func.id if isinstance(call.func, ast.Name) else ""
                if name in classes and len(call.args) > argument:
                    found.update(said(call.args[argument], function, functions))
    return found


def begins(sentence: str, says: str) -> bool:
    """Whether a sentence begins as an entry says.

    >>> begins("a write at … runs over an object into another", "a … at … runs over")
    True
    """
    pattern = ".+".join(map(re.escape, says.split("…")))
    return re.match(pattern, sentence) is not None
