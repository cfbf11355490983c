"""What a walk ends with where a rule is broken."""


class BrokenRuleError(Exception):
    """A rule that was broken; the message says which one, and how."""
