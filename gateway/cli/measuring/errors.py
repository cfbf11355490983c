"""Why a measuring run does not begin, or ends early. Each is one sentence with what to do."""


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


class FileError(MeasureError):
    """A file of readings that cannot be written, or cannot be gone on with."""
