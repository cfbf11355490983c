"""The profiles that come with the gateway."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Final

from gateway.drives.profile import Profile

SUFFIX: Final = ".toml"
FOLDER: Final = "profiles"


@cache
def names() -> tuple[str, ...]:
    """Return the names of all shipped profiles, sorted."""
    folder = files("gateway.drives") / FOLDER
    return tuple(
        sorted(file.name.removesuffix(SUFFIX) for file in folder.iterdir() if file.name.endswith(SUFFIX))
    )


def is_name(drive: str) -> bool:
    """Whether ``drive`` names a shipped profile rather than a file.

    >>> is_name("oriental-az"), is_name("./mine.toml"), is_name("mine.toml")
    (True, False, False)
    """
    return "/" not in drive and not drive.endswith(SUFFIX)


def text_of(name: str) -> str:
    """Return the text of a shipped profile.

    Raises:
        KeyError: there is none of this name.
    """
    if name not in names():
        raise KeyError(name)
    return (files("gateway.drives") / FOLDER / f"{name}{SUFFIX}").read_text(encoding="utf-8")


@cache
def shipped(name: str) -> Profile:
    """Return a shipped profile. The tests check its file, so it is not checked at each read.

    Raises:
        KeyError: there is none of this name.
    """
    return Profile.model_validate(tomllib.loads(text_of(name)))
