"""No constant of the hot path is of the one kind that gets lost when it is compiled.

mypyc keeps a ``Final`` tuple of nothing but floats unboxed, and takes it for one that was never set: whoever
reads it at run time, in the module or out of it, gets a NameError ("value for final name was not set"). It
compiles without a word, and as Python everything works. ``Final[tuple[float, ...]]`` is kept boxed and is
well; so is a tuple with anything else in it.
"""

import ast
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tools import compiled

ROOT = Path(__file__).resolve().parent.parent.parent


def is_lost(value: object, annotation: str) -> bool:
    """Whether compiled code could not read a constant of this value and annotation."""
    if "..." in annotation:
        return False
    leaves = list(leaves_of(value))
    return bool(leaves) and all(leaf is float for leaf in leaves)


def leaves_of(value: object) -> Iterator[type]:
    """Types of what stands in a plain tuple, and in those inside it."""
    for item in value if type(value) is tuple else ():
        if type(item) is tuple:
            yield from leaves_of(item)
        else:
            yield type(item)


def lost_constants(body: list[ast.stmt], values: Mapping[str, Any]) -> list[str]:
    """Names of the constants of a module, and of its classes, that compiled code could not read."""
    found = []
    for statement in body:
        if isinstance(statement, ast.ClassDef):
            inside = lost_constants(statement.body, vars(values[statement.name]))
            found += [f"{statement.name}.{name}" for name in inside]
        if not isinstance(statement, ast.AnnAssign) or not isinstance(statement.target, ast.Name):
            continue
        annotation = ast.unparse(statement.annotation)
        is_final = annotation.removeprefix("typing.").startswith("Final")
        if is_final and statement.value is not None and is_lost(values[statement.target.id], annotation):
            found.append(statement.target.id)
    return found


def test_no_constant_of_the_hot_path_is_a_tuple_of_nothing_but_floats() -> None:
    modules = compiled.modules(ROOT / "gateway")
    assert "gateway/exchange/axis/record_layout.py" in modules
    lost = []
    for name in modules:
        module = import_module(name.removesuffix(".py").replace("/", ".").removesuffix(".__init__"))
        body = ast.parse((ROOT / name).read_text()).body
        lost += [f"{name}: {constant}" for constant in lost_constants(body, vars(module))]
    assert not lost, (
        f"{lost}: compiled, reading it is a NameError, for mypyc takes a Final of unboxed floats for one "
        "that was never set; write Final[tuple[float, ...]]"
    )


@pytest.mark.parametrize(
    ("line", "lost"),
    [
        ("_LEVEL: Final = (0.0, 0.0, 0.0, 0.0)", ["_LEVEL"]),
        ("_NO_LINE: Final = (0.0, 0.0)", ["_NO_LINE"]),
        ("ONE: Final = (1.5,)", ["ONE"]),
        ("NESTED: Final = ((0.0, 1.0), (2.0, 3.0))", ["NESTED"]),
        ("TOLD: Final[tuple[float, float]] = (0.0, 0.0)", ["TOLD"]),
        ("WORKED_OUT: typing.Final = (float('1'), -2.0)", ["WORKED_OUT"]),
        ("UNPACKED: Final = (*(0.0, 1.0), 2.0)", ["UNPACKED"]),
        ("class Curve:\n    ENDS: Final = (0.0, 1.0)", ["Curve.ENDS"]),
        ("_LEVEL: Final[tuple[float, ...]] = (0.0, 0.0)", []),
        ("WITH_INTEGER: Final = (0.0, 1)", []),
        ("WITH_TEXT: Final = (0.0, 'x')", []),
        ("INTEGERS: Final = (1, 2)", []),
        ("NONE: Final = ()", []),
        ("FLOAT: Final = 2.0**-23", []),
        ("LIST: Final = [0.0, 1.0]", []),
        ("PLAIN = (0.0, 0.0)", []),
    ],
)
def test_which_constants_are_lost_is_what_compiling_them_showed(line: str, lost: list[str]) -> None:
    source = "import typing\nfrom typing import Final\n" + line
    values: dict[str, Any] = {}
    exec(source, values)
    assert lost_constants(ast.parse(source).body, values) == lost
