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


def told_sense(source: SourceText, context: FileContext, own_key: str | None) -> ErrorSense | None:
    """Return the sense that was told by ``error_sense`` or by the format's own key, or None.

    Raises:
        TabFileError: both were told and contradict each other.
    """
    own: ErrorSense | None = None if own_key is None else getattr(context, own_key)
    if own is not None and context.error_sense not in (None, own):
        assert context.error_sense is not None
        raise source.error(
            f"{own_key} {own.value} and error_sense {context.error_sense.value}", "one of the two keys"
        )
    return own if own is not None else context.error_sense


def required_sense(
    source: SourceText,
    context: FileContext,
    own_key: str | None,
    what: str,
    why: str = "no manual says which sign its errors have",
) -> ErrorSense:
    """Return the sense of a file of which nothing proves it.

    ``what`` names the kind of file, ``why`` says why the sense is asked for.

    Raises:
        TabFileError: nobody told it: both readings are shown.
    """
    sense = told_sense(source, context, own_key)
    if sense is None:
        key = own_key or "error_sense"
        raise source.error(
            f"{what}: {why}",
            f"{choices(key)}; one test move shows which is right",
            readings=_READINGS,
        )
    return sense
