"""Why a measuring run does not begin, or ends early. Each error is one sentence with the remedy."""

from signal import Signals


class MeasureError(Exception):
    """Base of all deliberate ends of a measuring run."""


class UndrivableError(MeasureError):
    """The register map is not sufficient to move this drive without knowing its make."""


class AxisError(MeasureError):
    """The axis does not follow its command, or is not in the required state."""


class InstrumentError(MeasureError):
    """The instrument is lost, or cannot be opened."""


class BadReadingError(MeasureError):
    """The received value is not a reading of this stop. Another one may be requested."""


class TakenBackError(MeasureError):
    """The user takes back the readings of this placement, because something slipped."""


class StoppedError(MeasureError):
    """The user ended it: Ctrl-C, SIGTERM, a q on the keyboard."""


class EndedEarlyError(MeasureError):
    """A run that began did not finish; its readings until then are kept."""

    def __init__(self, why: str, took: int, stopped_by: Signals | None) -> None:
        """``took``: readings in the file; ``stopped_by``: the signal, if one stopped it."""
        super().__init__(why)
        self.took = took
        self.stopped_by = stopped_by


class FileError(MeasureError):
    """A file of readings that cannot be written or continued."""
