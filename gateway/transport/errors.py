"""Errors of opening a port or an address. Their sentences contain the remedy."""


class TransportError(Exception):
    """An address or a port could not be opened.

    ``detail`` is one sentence with what was found and the remedy; a caller that knows the configuration key
    puts it in front.
    """

    def __init__(self, detail: str) -> None:
        super().__init__(detail)
        self.detail = detail


class AbsentError(TransportError):
    """Absent: unplugged, switched off, not listening. It may appear later."""


class RefusedError(TransportError):
    """The user must act: in use by another program, no permission, not a serial port."""
