"""Tables of states that a test has by hand, as text."""


def walk(text: str) -> dict[tuple[str, str], str]:
    """Return the cells of a table by column and row: as a rule the state and what happens in it."""
    head, *rows = (line.split() for line in text.strip().splitlines())
    return {(column, row): cell for row, *cells in rows for column, cell in zip(head, cells, strict=True)}
