"""Why a measuring run does not begin, or ends early. Each is one sentence with what to do."""

from signal import Signals


class MeasureError(Exception):
    """Base of everything that ends a measuring run on purpose."""


class UndrivableError(MeasureError):
    """The register map does not say enough to move this drive without knowing its make."""


class AxisError(MeasureError):
    """The axis does not do what it was told, or is not as it has to be."""


class InstrumentError(MeasureError):
    """The instrument is gone, or cannot be opened."""


class BadReadingError(MeasureError):
    """Something came that is no reading of this stop. Another one may be asked for."""


class StoppedError(MeasureError):
    """Somebody wants it to end: Ctrl-C, SIGTERM, a q on the keyboard."""


class EndedEarlyError(MeasureError):
    """A run that began did not come to its end; what was read until then is kept."""

    def __init__(self, why: str, took: int, stopped_by: Signals | None) -> None:
        """``took``: readings in the file; ``stopped_by``: the signal, where one stopped it."""
        super().__init__(why)
        self.took = took
        self.stopped_by = stopped_by


class FileError(MeasureError):
    """A file of readings that cannot be written, or cannot be gone on with."""
