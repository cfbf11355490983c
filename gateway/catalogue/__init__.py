"""Everything that the gateway may report: what it means, its usual cause, what to do.

Pure data, below every other layer. Code that reports something takes the entry from here, so every name is
spelt correctly and explained. The command ``explain`` and docs/messages.md show the catalogue.
"""
