"""The shapes of what programs read: ``python -m tests.promises.shapes`` adds what is new to ``shapes.txt``.

A heading there is a document and the path of an object in it; its items are the keys of the object, each
with the kinds of its values where any was seen. ``*`` stands for a name that the configuration gives. Nothing
goes: some program may rely on each of them.
"""

import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, get_args

import msgspec

from gateway.exchange.commands import TableFor
from gateway.ipc.messages import Reply, Request
from tests.promises.listing import Listed, write
from tests.same.commands import BAD_TABLE, TAKEN, Desk

FILE: Final = Path(__file__).with_name("shapes.txt")
NAMED: Final = frozenset({"x", "y", "xy", "cnc", "1", "2"})
"""Names in the configuration of the desk."""
KINDS: Final = {bool: "bool", int: "number", float: "number", str: "text"}
LABEL: Final = re.compile(r'(\w+)="')
COMMANDS: Final = (
    "check --json gateway.toml",
    "status gateway.toml --json",
    "disable gateway.toml x --json",
    "enable gateway.toml x --json",
    "reference gateway.toml x --yes --json",
    "reload gateway.toml --json",
    "explain drive-silent --json",
    "table show tables/x.tab --json",
    "budget gateway.toml --json",
    "drives show jmc-rc --json",
    "capture gateway.toml --json",
)
GROUPS: Final = ("table", "drives")
"""Commands with commands of their own."""
EVENTS: Final = frozenset(
    {
        "http-ready",
        "mqtt-connected",
        "table-activated",
        "table-handed-over",
        "table-rejected",
        "table-mended",
        "mqtt-command",
        "gain-changed",
        "disabled",
        "enabled",
        "referenced",
        "nothing-to-reload",
    }
)
"""What happens here by our doing; a busy machine has more to tell."""
DOCUMENTS: Final = ("/healthz", "/status", "/tables/x", "/frames/xy", "/history/x")
Shapes = dict[str, set[str]]


def shapes() -> Shapes:
    """Return the kinds of values at each path of each document, of running processes."""
    found: Shapes = defaultdict(set)
    for path, kind in (*_messages(), *_documents()):
        found[path].update((kind,) if kind else ())
    return found


def listed(found: Shapes) -> Listed:
    """Return each path as a heading and an item.

    >>> sorted(listed({"status axes.*.gain": {"number"}, "status axes": set()}))
    [('status', 'axes'), ('status axes.*', 'gain number')]
    """
    split = {path: max(path.rfind("."), path.rfind(" ")) for path in found}
    return {
        (path[: split[path]], " ".join((path[split[path] + 1 :], *sorted(kinds))))
        for path, kinds in found.items()
    }


def _messages() -> Iterator[tuple[str, str]]:
    """Yield the fields of each message of the socket."""
    for struct in (*get_args(Request), *get_args(Reply), TableFor):
        name = struct.__struct_config__.tag or struct.__name__
        for each in msgspec.structs.fields(struct):
            yield f"message {name} {each.encode_name}", "required" if each.required else "optional"


def _documents() -> Iterator[tuple[str, str]]:
    with TemporaryDirectory(prefix="shapes-") as folder:
        desk = Desk(Path(folder))
        desk.printed("check --compile --json gateway.toml")
        with desk.running():
            for what in ("a first target", "another one"):
                list(desk.moves(what))
            desk.changed(lambda: desk.write_table("X", "0.05"), *TAKEN)
            desk.changed(lambda: (desk.folder / "tables" / "x.tab").write_text(BAD_TABLE), "table-rejected")
            desk.changed(lambda: desk.write_table("X", "0.02"), "table-mended", *TAKEN)
            list(desk.commanded("gain", {"axes": ["x"], "forward": 1.0, "backward": 0.5}))
            list(desk.commanded("gain", {"axes": ["x"], "forward": 1.0, "backward": 1.0}))
            for command in COMMANDS:
                for document in desk.printed(command):
                    yield from shape_of(
                        f"$ {' '.join(command.split(' gateway.toml')[0].split()[:2])}", document
                    )
            for path in DOCUMENTS:
                for document in desk.documents(path):
                    yield from shape_of(f"GET {path.replace('/xy', '/*').replace('/x', '/*')}", document)
            for line in desk.text("/metrics").splitlines():
                name, _, labels = line.partition("{")
                if not line.startswith("#"):
                    yield f"metric {name.split()[0]}", ""
                    yield from ((f"metric {name.split()[0]} {label}", "") for label in LABEL.findall(labels))
            for topic, said in desk.topics().items():
                if "/command/" in topic:  # these are what was asked
                    continue
                is_event = topic.endswith("/event")
                shown = [each for each in said if each["event"] in EVENTS] if is_event else said
                yield from shape_of(f"MQTT {_of_any(topic)}", shown)


def _of_any(topic: str) -> str:
    """Return a topic without the names that a configuration gives.

    >>> _of_any("pitch-gateway/same/axis/x/table")
    'pitch-gateway/*/axis/*/table'
    """
    return re.sub(r"(?<=[/_])(same|x|y|xy)(?=/|$)", "*", topic)


def shape_of(where: str, value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield each path inside of a value, with the kind of what is there; "" for null.

    >>> list(shape_of("status", {"axes": {"x": {"at": [1.5, None]}}}))
    [('status axes.*.at[]', 'number'), ('status axes.*.at[]', '')]
    """
    if isinstance(value, dict):
        for key, each in value.items():
            name = "*" if key in NAMED else key
            yield from shape_of(where, each, f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for each in value:
            yield from shape_of(where, each, f"{path}[]")
    else:
        yield f"{where} {path}".rstrip(), KINDS.get(type(value), "")


if __name__ == "__main__":
    write(FILE, listed(shapes()))
    sys.stdout.write(f"{FILE}\n")
