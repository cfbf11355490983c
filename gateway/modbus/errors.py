"""Errors of the Modbus layer, by cause."""


class ProtocolError(Exception):
    """Base of all intentional errors of this layer; any other error is a bug of ours.

    Decoders never raise: bad bytes from a wire are counted and dropped, and are no error of the program.
    """


class FrameError(ProtocolError):
    """A frame that cannot be built, or a decoder that cannot be set up."""


class RegisterError(ProtocolError):
    """Base of the errors of register fields."""


class RegisterFieldError(RegisterError):
    """The description of a field is impossible: an address, a bit or a scale out of range."""


class RegisterRangeError(RegisterError):
    """A value that a field cannot hold. Nothing is ever wrapped or clamped."""


class RegisterDataError(RegisterError):
    """Fewer bytes than the field is long."""
