"""Under what readings were taken, as far as their files say it: of which axis, and with a table or without.

A file of ``pitch-gateway measure`` says ``# compensation: off``, or ``active`` with the SHA-256 of the table
that was in force; a person may write ``off`` or ``on``. Where nothing is said, nothing is concluded.
"""

import re
from collections.abc import Mapping
from typing import Final

from gateway.metrology.errors import ReadingsError

COMPENSATION: Final = "compensation"
STATED: Final = (COMPENSATION, "axis")
"""The facts that decide something, in lower case."""
_OFF: Final = ("off", "none", "no", "without")
_ON: Final = ("on", "active", "yes", "with")
_DIGEST: Final = re.compile(r"\b[0-9a-f]{64}\b")


def was_corrected(facts: Mapping[str, str]) -> bool | None:
    """Whether a table was in use; None where the facts do not say it.

    >>> [was_corrected({"compensation": said}) for said in ("off", "on, table 3", "?")]
    [False, True, None]
    """
    word = re.match(r"[a-z]*", facts.get(COMPENSATION, "").strip().lower())
    if word is None or word[0] not in (*_OFF, *_ON):
        return None
    return word[0] in _ON


def table_digest(facts: Mapping[str, str]) -> str | None:
    """Return the SHA-256 of the table that was in use, None where it is not said."""
    found = _DIGEST.search(facts.get(COMPENSATION, "").lower())
    return found[0] if found else None


def is_same_axis(one: str | None, other: str | None) -> bool:
    """Whether two names may be of one axis; only letters are compared, a longer name is a text for people.

    >>> is_same_axis("x", "X"), is_same_axis("x", None), is_same_axis("x", "y"), is_same_axis("x", "X-axis")
    (True, True, False, True)
    """
    if not one or not other or len(one) != 1 or len(other) != 1:
        return True
    return one.casefold() == other.casefold()


def check_same_axis(name: str, axis: str | None, other: str, other_axis: str | None) -> None:
    """Check that two files are of one axis. Raises ReadingsError."""
    if not is_same_axis(axis, other_axis):
        raise ReadingsError(
            f"{name} is of axis {axis}, {other} of axis {other_axis}: give two files of one axis, or "
            "correct the line in the file that names the wrong one"
        )


def check_uncorrected(name: str, facts: Mapping[str, str], instead: str) -> None:
    """Check that readings can show the whole error of an axis; ``instead`` is what can be done with others.

    Raises:
        ReadingsError: a table was in use.
    """
    if was_corrected(facts):
        raise ReadingsError(
            f"{name}: was measured with a table in use (# {COMPENSATION}: {facts[COMPENSATION]}), so it "
            f"shows what that table left, not the error of the axis: {instead}; or "
            "correct that line if it is wrong"
        )


def check_corrected(name: str, facts: Mapping[str, str], table: str, digest: str) -> None:
    """Check that readings can show what a table left of the error.

    Raises:
        ReadingsError: none was in use, or another one.
    """
    if was_corrected(facts) is False:
        raise ReadingsError(
            f"{name}: was measured without a table (# {COMPENSATION}: {facts[COMPENSATION]}), so it shows "
            f"the whole error, and {table} with it would correct twice: make a table of these readings with "
            "table build; or correct that line if it is wrong"
        )
    stated = table_digest(facts)
    if stated is not None and stated != digest:
        raise ReadingsError(
            f"{name}: was measured with the table of SHA-256 {stated[:12]}…, and {table} has {digest[:12]}…: "
            "give the table that was in use, as it was; or take that line out if it is the same in "
            "another file"
        )


def check_together(name: str, facts: Mapping[str, str], other: str, other_facts: Mapping[str, str]) -> None:
    """Check that readings of two files can make one mean.

    Raises:
        ReadingsError: one was measured with a table and the other without, or with another one.
    """
    one, two = was_corrected(facts), was_corrected(other_facts)
    digests = table_digest(facts), table_digest(other_facts)
    if (one is not None and two is not None and one is not two) or (
        all(digests) and digests[0] != digests[1]
    ):
        raise ReadingsError(
            f"{name} was measured with {COMPENSATION} {facts[COMPENSATION]}, {other} with "
            f"{other_facts[COMPENSATION]}: their readings have no mean in common"
        )
