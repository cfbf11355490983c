"""Finding a key of the configuration by what a person calls it."""

from gateway.config.reference.tables import TABLES, Row, rows


def find_keys(asked: str) -> list[tuple[str, Row]]:
    """Return the keys that are called so, each with the name of its table; a path names the section first.

    >>> [name for name, _ in find_keys("axis.x.gain")], [name for name, _ in find_keys("gap_ms")]
    (['axis'], ['line', 'axis.registers'])
    """
    *path, key = asked.strip().strip("[]").split(".")
    return [
        (name, row)
        for name, table in TABLES.items()
        if not path or name.split(".")[0] == path[0]
        for row in rows(table)
        if row.key == key
    ]


def all_keys() -> list[str]:
    """Return every key once, for completion."""
    return list(dict.fromkeys(row.key for table in TABLES.values() for row in rows(table)))
