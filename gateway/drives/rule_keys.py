"""The keys of a register map that make a frame stop, home or move the axis."""

from collections.abc import Iterator

from gateway.drives.motion import Action
from gateway.drives.registers import RegisterMap
from gateway.drives.rules import TRIGGER_ACTIONS, ModeSpec, TriggerSpec

KeyPath = tuple[str | int, ...]


def rule_key(registers: RegisterMap, *actions: Action) -> KeyPath | None:
    """Return the first key that gives a value one of these meanings, as a path inside the map; None: no key.

    >>> trigger = {"address": 2, "start": [1], "otherwise": "stop"}
    >>> registers = RegisterMap.model_validate(
    ...     {"command": [{"address": 5, "type": "int32"}], "trigger": [trigger]}
    ... )
    >>> rule_key(registers, Action.STOP)
    ('trigger', 0, 'otherwise')
    >>> rule_key(registers, Action.HOME)
    """
    for path, rule in _rules(registers):
        for _, action in rule.listed(TRIGGER_ACTIONS):
            if action in actions:
                return (*path, action.value)
        if rule.otherwise in actions:
            return (*path, "otherwise")
    return None


def _rules(registers: RegisterMap) -> Iterator[tuple[KeyPath, ModeSpec | TriggerSpec]]:
    if registers.mode is not None:
        yield ("mode",), registers.mode
    for index, command in enumerate(registers.command):
        if command.mode is not None:
            yield ("command", index, "mode"), command.mode
    for index, trigger in enumerate(registers.trigger):
        yield ("trigger", index), trigger
