"""Writes the man pages from the help of the command line: ``python tools/man_pages.py FOLDER``.

One page for each command. Debian's click-man is not used: it knows nothing of paragraphs of examples, and of
typer's own classes.
"""

import argparse
import os
import re
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.main import get_command

from gateway import __version__
from gateway.cli.app import app

WIDTH = 72
"""Of a line of roff, before signs are escaped."""
EXAMPLES = re.compile(r"^Examples?:\n(?P<text>(?:[ \t]+.*\n|\n)+)", re.MULTILINE)
FILES = """\
.TP
.I /etc/pitch\\-gateway/gateway.toml
The configuration of the installed services.
.TP
.I /etc/pitch\\-gateway/tables/
Its tables.
.TP
.I /var/lib/pitch\\-gateway/
What is compiled from them, and what each axis remembers of its last position.
"""
EXIT_CODES = """\
.TP
.B 0
Good.
.TP
.B 1
The input is bad, or what was asked for did not succeed;
standard error says why.
.TP
.B 2
Wrong usage.
"""


def escaped(text: str) -> str:
    r"""Return text that roff takes as it is.

    >>> escaped(".tab - a\\b 'c'")
    "\\&.tab \\- a\\eb 'c'"
    """
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("…", "...")
    return re.sub(r"^(?=[.'])", r"\\&", text, flags=re.MULTILINE)


def paragraphs(text: str) -> Iterator[str]:
    """Yield the paragraphs of a help text, each as one line of roff."""
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        if paragraph:
            text = re.sub(r"`+", "", " ".join(paragraph.split()))
            yield escaped("\n".join(textwrap.wrap(text, WIDTH, break_on_hyphens=False)))


def page(command: Any, names: tuple[str, ...], date: str) -> str:
    """Return the page of a command; ``names`` are those that a person types."""
    full = " ".join(names)
    help_text = (command.help or "").replace("\b", "") + "\n"
    examples = EXAMPLES.search(help_text)
    first, *rest = paragraphs(EXAMPLES.sub("", help_text))
    lines = [
        f'.TH {"-".join(names).upper()} 1 {date} "pitch-gateway {__version__}" "pitch-gateway"',
        ".SH NAME",
        f"{escaped('-'.join(names))} \\- {' '.join(first.split()).rstrip('.')}",
        ".SH SYNOPSIS",
        f".B {escaped(full)}",
        *(f".I {escaped(part)}" for part in usage(command)),
        ".SH DESCRIPTION",
        first,
        *(line for text in rest for line in (".PP", text)),
        *parameters(command),
    ]
    if subcommands := getattr(command, "commands", {}):
        lines.append(".SH COMMANDS")
        for name, each in subcommands.items():
            summary = next(paragraphs((each.help or "").split("\n\n", 1)[0]), "")
            lines += [".TP", f".BR {escaped('-'.join((*names, name)))} (1)", summary]
    if examples:
        # Each command stands on a line of its own; one that is broken in two goes on as it was written.
        example = [line.strip() for line in examples["text"].strip().splitlines()]
        lines += [".SH EXAMPLES", ".nf", *(escaped(line) for line in example if line), ".fi"]
    lines += [".SH EXIT STATUS", EXIT_CODES.rstrip(), ".SH FILES", FILES.rstrip(), *see_also(names)]
    return "\n".join(lines) + "\n"


def usage(command: Any) -> list[str]:
    """Return what may follow the name, as click says it."""
    import click

    with click.Context(command) as context:
        return list(command.collect_usage_pieces(context))


def parameters(command: Any) -> list[str]:
    """Return the arguments and options, each with its help and its default."""
    lines = []
    options = [each for each in command.params if each.param_type_name == "option" and not each.hidden]
    if arguments := [each for each in command.params if each.param_type_name == "argument"]:
        lines.append(".SH ARGUMENTS")
        for each in arguments:
            lines += [".TP", f".I {escaped(each.metavar or each.name.upper())}", described(each)]
    lines.append(".SH OPTIONS")
    for each in options:
        names = ", ".join((*each.opts, *each.secondary_opts))
        value = "" if each.is_flag else f" {each.metavar or each.name.upper().replace('_', '-')}"
        lines += [
            ".TP",
            f'.BR "{escaped(names)}"' + (f' "{escaped(value)}"' if value else ""),
            described(each),
        ]
    return [*lines, ".TP", '.BR "\\-h, \\-\\-help"', "Show the help and exit."]


def described(parameter: Any) -> str:
    """Return the help of a parameter with what it is without being given, where that says something."""
    text = " ".join(paragraphs(getattr(parameter, "help", None) or ""))
    default = parameter.default
    if isinstance(default, str | int | float) and not isinstance(default, bool) and str(default):
        text += f" Default: {escaped(str(getattr(default, 'value', default)))}."
    return text.strip() or "See the description."


def see_also(names: tuple[str, ...]) -> list[str]:
    """Return where to read on."""
    above = [".BR pitch\\-gateway (1)."] if len(names) > 1 else []
    return [".SH SEE ALSO", *above, "The folder of documents of the package."]


def pages(command: Any, names: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield each command with the names that lead to it."""
    yield names, command
    for name, each in getattr(command, "commands", {}).items():
        if not each.hidden:
            yield from pages(each, (*names, name))


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="where the pages go; is made where it is missing")
    folder: Path = parser.parse_args().folder
    made_at = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))
    date = time.strftime("%Y-%m-%d", time.gmtime(made_at))
    folder.mkdir(parents=True, exist_ok=True)
    for names, command in pages(get_command(app), ("pitch-gateway",)):
        (folder / f"{'-'.join(names)}.1").write_text(page(command, names, date), encoding="utf-8")


if __name__ == "__main__":
    main()
