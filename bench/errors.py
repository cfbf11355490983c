"""What can go wrong with a run of the bench."""


class BenchError(Exception):
    """The bench cannot go on; the sentence says why and what to do."""
