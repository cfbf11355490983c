"""Units of time. Instants and spans are integers of nanoseconds; the unit is in every name."""

from typing import Final

US_PER_MS: Final = 1000
NS_PER_US: Final = 1_000
NS_PER_MS: Final = 1_000_000
NS_PER_S: Final = 1_000_000_000
