"""What is wrong with a line that is not TOML, in the words of somebody who does not know TOML."""

import re
from typing import Final

GRAMMAR: Final = "see https://toml.io for the grammar"
_ASSIGNED: Final = re.compile(r"""(?P<key>[\w.\-"']+)[ \t]*=[ \t]*(?P<begun>[^=\[{,"']*)$""")
_COLON: Final = re.compile(r"""[ \t]*(?P<key>[\w.\-]+)[ \t]*:[ \t]*(?P<value>\S.*)""")
_NAKED: Final = re.compile(r"[ \t]*[\w.\-]+[ \t]+(?P<value>[^=\s].*)")
_NUMBER: Final = r"[+-]?\d[\d_]*"
_BOOLEANS: Final = {"yes": "true", "no": "false", "true": "true", "false": "false"}
_TYPED: Final = "“”„‟«»‘’"
"""Quotes that word processors make of straight ones."""


def in_words(line: str, column: int | None) -> str:
    """Return what to do about a line that is not TOML; ``column``, from 1, is where reading stopped.

    >>> in_words("counts_per_unit = 1000,5", 23)
    'decimal point, not comma: counts_per_unit = 1000.5'
    >>> in_words("name = mill-1", 8)
    'text needs quotes: name = "mill-1"'
    """
    at = len(line) if column is None else column - 1
    before, rest = line[:at], line[at:]
    if line.lstrip().startswith(("//", ";", "--", "'")):
        return "a comment begins with #"
    if any(quote in line for quote in _TYPED):
        return "quotes are straight in TOML: \"text\" or 'text'"
    if opened := re.search(r"""([\w.\-]+)[ \t]*=[ \t]*(["'])([^"']*)$""", line):
        return f"a text ends with the quote that it begins with, on the same line: {_whole(opened)}"
    if "\\" in line and '"' in before:
        return "a text with backslashes stands in single quotes, as in 'C:\\tables'"
    assigned = _ASSIGNED.search(before)
    if assigned is not None:
        value = (assigned["begun"] + re.split(r"[\n#}\]]", rest, maxsplit=1)[0]).strip()
        return _of_value(assigned["key"], value)
    return _of_line(line, before)


def _of_value(key: str, value: str) -> str:
    first = value.split(",", maxsplit=1)[0].strip()
    if not value:
        return f"a value is missing behind {key} ="
    if comma := re.fullmatch(rf"({_NUMBER}),(\d+)", value):
        return f"decimal point, not comma: {key} = {comma[1]}.{comma[2]}"
    if re.fullmatch(rf"{_NUMBER}(?:[ '’.]\d{{3}})+(?:[.,]\d+)?", value):
        plain = re.sub(r"[ '’.](?=\d{3})", "", value).replace(",", ".")
        return f"a number has nothing between its digits: {key} = {plain}"
    if re.fullmatch(r"[+-]?\.\d+|[+-]?\d+\.", first):
        number = re.sub(r"\.$", ".0", re.sub(r"^([+-]?)\.", r"\g<1>0.", first))
        return f"a digit stands on both sides of the decimal point: {key} = {number}"
    if re.fullmatch(r"[+-]?0\d+", first):
        return f"a number does not begin with 0, and text needs quotes: {key} = {_quoted(first)}"
    if unit := re.fullmatch(rf"({_NUMBER}(?:\.\d+)?)\s*([A-Za-zµ°%/]+)", first):
        return f"a number stands without its unit, and text needs quotes: {key} = {unit[1]}"
    if first.lower() in _BOOLEANS:
        return f"true and false are written small, without quotes: {key} = {_BOOLEANS[first.lower()]}"
    return f"text needs quotes: {key} = {_quoted(first.strip(';'))}"


def _of_line(line: str, before: str) -> str:
    if line.lstrip().startswith("[") and "]" not in line:
        return (
            f"the name of a table ends with ]: {line.strip()}{']]' if line.strip().startswith('[[') else ']'}"
        )
    if (colon := _COLON.fullmatch(line)) is not None:
        return f"= stands between a key and its value: {colon['key']} = {colon['value']}"
    if before.count("{") > before.count("}"):
        return "what stands in { } is separated by commas and ends with } on the same line"
    if before.count("[") > before.count("]"):
        return "what stands in [ ] is separated by commas and ends with ]"
    if (naked := _NAKED.fullmatch(line)) is not None and "=" not in line:
        return f"= stands between a key and its value; a comment begins with #: {naked['value'].strip()}"
    return f"a key, = and a value stand on a line, or the name of a table in [ ]; {GRAMMAR}"


def _whole(opened: re.Match[str]) -> str:
    key, quote, text = opened.groups()
    return f"{key} = {quote}{text.strip()}{quote}"


def _quoted(text: str) -> str:
    return f'"{text.strip(chr(34) + chr(39))}"'
