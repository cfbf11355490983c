"""The status page: static files, served as they are."""

from typing import Final

FILES: Final = ("index.html",)
"""Every file of the page, by its name in this folder; nothing else is served."""
