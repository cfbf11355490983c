"""Configurations and tables that a test needs but is not about, written from what matters to it.

Where the text itself is the subject of a test, it stands there.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

Keys = Mapping[str, Any]
AXIS: Final[Keys] = {
    "line": "xyz",
    "unit_id": 1,
    "units": "mm",
    "counts_per_unit": 1000.0,
    "travel": [0.0, 100.0],
    "referenced": "absolute",
}
"""What an axis has that nothing else was told of."""


def toml_of(value: object) -> str:
    """Return a value as TOML has it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml_of(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_of, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def section(header: str, keys: Keys) -> str:
    """Return a section with a line for each key; a key of None is left out."""
    lines = [f"{key} = {toml_of(value)}\n" for key, value in keys.items() if value is not None]
    return f"\n{header}\n" + "".join(lines)


def tcp(port: int) -> dict[str, str]:
    """Return the place of a drive or a controller on this machine."""
    return {"tcp": f"127.0.0.1:{port}"}


def line(drives: int | Keys, controllers: Mapping[str, int | Keys], name: str = "xyz", **keys: object) -> str:
    """Return a line with its controllers by name; a number is a TCP port of this machine."""
    way = tcp(drives) if isinstance(drives, int) else drives
    text = section(f"[line.{name}]", {"drives": way, **keys})
    for controller, place in controllers.items():
        more = tcp(place) if isinstance(place, int) else place
        text += section(f"[[line.{name}.controllers]]", {"name": controller, **more})
    return text


def registers(**addresses: int) -> dict[str, Any]:
    """Return positions of 32 bits by what they are for: ``registers(command=100, actual=110)``."""
    return {key: [{"address": address, "type": "int32"}] for key, address in addresses.items()}


COMMAND: Final = registers(command=100)


def axis(name: str = "x", registers: Keys | None = COMMAND, more: str = "", **keys: object) -> str:
    """Return an axis: ``AXIS``, changed and extended by keys, with its registers and lines of TOML."""
    mapped = {f"registers.{key}": value for key, value in (registers or {}).items()}
    return section(f"[axis.{name}]", {**AXIS, **keys, **mapped}) + more


def gateway_toml(*sections: str, name: str = "trial", http: str = "", **keys: object) -> str:
    """Return a whole configuration; ``http`` is where its page is, nowhere by default."""
    head = section("[gateway]", {"name": name, **keys}) + section("[http]", {"listen": http})
    return head + "".join(sections)


def one_axis(drives: int, port: int) -> str:
    """Return the configuration of an axis x that is corrected by ``x.tab``, and its controller ``cnc``."""
    return gateway_toml(line(drives, {"cnc": port}), axis(compensation="on", table="x.tab"))


def tab(*corrections: float | tuple[float, float], name: str = "X", interval: float = 50.0) -> str:
    """Return a table file from 0 on, in mm; a pair of corrections is forward and backward."""
    pairs = [each if isinstance(each, tuple) else (each, each) for each in corrections]
    rows = "".join(f"{n * interval} {forward} {backward}\n" for n, (forward, backward) in enumerate(pairs))
    head = f"CNC10 TAB FILE VERSION 3\nAXIS {name}\nUNITS MILLIMETER\nINTERVAL {interval}\n"
    return f"{head}ENTRIES {len(pairs)}\n{rows}"


RAMP: Final = tab(0.0, 0.05, 0.1)
"""Adds 0.05 mm at 50 mm and 0.1 mm at 100 mm, in both directions."""
STEEPER: Final = tab(0.0, 0.1, 0.2)


def written(folder: Path, text: str, tables: Mapping[str, str | bytes] | None = None) -> Path:
    """Write a configuration with its table files, by default ``RAMP`` as x.tab; return its path."""
    for name, content in ({"x.tab": RAMP} if tables is None else tables).items():
        (folder / "tables").mkdir(exist_ok=True)
        data = content if isinstance(content, bytes) else content.encode()
        (folder / "tables" / name).write_bytes(data)
    path = folder / "gateway.toml"
    path.write_text(text)
    return path
