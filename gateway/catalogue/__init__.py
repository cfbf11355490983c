"""Everything that the gateway may say about itself: what it means, what usually causes it, what to do.

Pure data, below every other layer: whoever says something takes the entry from here, so that no name is
misspelt and none is without an explanation. The command ``explain`` and docs/messages.md show it.
"""
