"""The sense of the errors in a file: which of two readings its author meant."""

from typing import Final

from gateway.tabfile.context import FileContext
from gateway.tabfile.options import ErrorSense, choices
from gateway.tabfile.text import SourceText

RULES: Final = {
    ErrorSense.ACTUAL_MINUS_COMMAND: "error = actual - commanded: subtracted",
    ErrorSense.COMMAND_MINUS_ACTUAL: "error = commanded - actual: added as it stands",
}
"""How an error becomes the amount to add, in words."""
_READINGS: Final = (
    "actual_minus_command: an error of +0.01 means that the nut stands 0.01 too far, so 0.01 is taken off",
    "command_minus_actual: an error of +0.01 means that the nut stands 0.01 short, so 0.01 is added",
)


def required_sense(
    source: SourceText,
    context: FileContext,
    what: str,
    why: str = "no manual says which sign its errors have",
) -> ErrorSense:
    """Return the sense of a file of which nothing proves it.

    ``what`` names the kind of file, ``why`` says why the sense is asked for.

    Raises:
        TabFileError: nobody told it: both readings are shown.
    """
    if context.error_sense is None:
        raise source.error(
            f"{what}: {why}",
            f"{choices('error_sense')}; one test move shows which is right",
            readings=_READINGS,
        )
    return context.error_sense
