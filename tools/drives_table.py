"""Writes the table of shipped profiles into docs/drives.md: run it after a profile was added or renamed."""

from pathlib import Path

from gateway.cli.drives_output import markdown_lines

DOCUMENT = Path(__file__).parents[1] / "docs" / "drives.md"
BEGIN, END = "<!-- table: python -m tools.drives_table -->\n", "<!-- end of the table -->\n"


def main() -> None:
    head, rest = DOCUMENT.read_text(encoding="utf-8").split(BEGIN)
    _, tail = rest.split(END)
    table = "".join(f"{line}\n" for line in markdown_lines())
    DOCUMENT.write_text(f"{head}{BEGIN}{table}{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
