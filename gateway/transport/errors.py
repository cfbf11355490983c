"""What can go wrong when a way to the outside is opened. The sentences say what to do about it."""


class TransportError(Exception):
    """An address or a port could not be opened.

    ``detail`` is one sentence with what was found and the remedy; whoever knows the configuration key puts it
    in front.
    """

    def __init__(self, detail: str) -> None:
        super().__init__(detail)
        self.detail = detail


class AbsentError(TransportError):
    """Nothing there (yet): unplugged, switched off, not listening. It may come by itself."""


class RefusedError(TransportError):
    """Somebody must do something: in use by another program, no permission, not a serial port."""
