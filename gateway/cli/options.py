"""Options of a command that belong together, as one dataclass: each field is declared once, there."""

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args

import typer
from typer.models import OptionInfo

from gateway.options import Option, OptionError


def takes_options(command: Callable[..., None]) -> Callable[..., None]:
    """Replace a command's dataclass parameters by options for their fields.

    A field that is a dataclass itself is replaced by its own fields. The annotations of the others are
    typer's, those of :mod:`gateway.options`, or declarations about table files. A value that is not allowed
    is wrong usage, whether the group, this function or the command itself refuses it.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    options: dict[str, Option] = {}
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        if is_dataclass(parameter.annotation):
            groups[name] = parameter.annotation
            found = [each.replace(kind=parameter.kind) for each in _options_of(parameter.annotation)]
        else:
            found = [parameter]
        for each in found:
            if (option := _option_of(each)) is not None:
                options[each.name] = option
            parameters.append(_typed(each))

    @wraps(command)
    def run(**given: Any) -> None:
        try:
            for name, option in options.items():
                option.check(name, given[name])
            for name, group in groups.items():
                given[name] = _filled(group, given)
            command(**given)
        except OptionError as error:
            hint = _typed_name(error.field, options.get(error.field))
            raise typer.BadParameter(error.why, param_hint=hint) from None

    # Typer reads this.
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _fields(group: Any) -> Iterator[inspect.Parameter]:
    yield from inspect.signature(group, eval_str=True).parameters.values()


def _options_of(group: Any) -> Iterator[inspect.Parameter]:
    for field in _fields(group):
        if is_dataclass(field.annotation):
            yield from _options_of(field.annotation)
            continue
        if isinstance(get_args(field.annotation)[1], OptionInfo | Option):
            yield field
        else:
            yield from _of_table(field)


def _option_of(parameter: inspect.Parameter) -> Option | None:
    declared = get_args(parameter.annotation)[1:]
    return declared[0] if declared and isinstance(declared[0], Option) else None


def _typed(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter in typer's form."""
    if (option := _option_of(parameter)) is None:
        return parameter
    kind = get_args(parameter.annotation)[0]
    return parameter.replace(annotation=Annotated[kind, _of_program(parameter.name, option)])


def _typed_name(field: str, option: Option | None) -> str:
    return f"--{(option and option.name) or field.replace('_', '-')}"


def _of_program(field: str, option: Option) -> Any:
    return typer.Option(
        _typed_name(field, option),
        help=option.help,
        metavar=option.metavar,
        show_default=option.shown_default,
        min=option.min,
        max=option.max,
        readable=not option.is_read_by_us,
        autocompletion=None if option.one_of is None else _completion(option.one_of),
    )


def _completion(allowed: Callable[[], Sequence[str | int]]) -> Callable[[str], list[str]]:
    def complete(incomplete: str) -> list[str]:
        return [word for word in map(str, allowed()) if word.startswith(incomplete)]

    return complete


def _of_table(field: inspect.Parameter) -> Iterator[inspect.Parameter]:
    """Yield an option about a table file; none if another option sets it too."""
    from gateway.tabfile.options import DECLARED

    declared = DECLARED[field.name]
    declaration = declared.option
    if not declaration.typed_as:
        is_old = declaration.renamed is not None
        option = typer.Option(
            declared.typed, metavar=declaration.metavar, help=declaration.help, hidden=is_old
        )
        yield field.replace(annotation=Annotated[declared.type | None, option])


def _filled(group: Any, given: dict[str, Any]) -> Any:
    """Return a group with its given values, and remove them from ``given``."""
    return group(
        **{
            field.name: _filled(field.annotation, given)
            if is_dataclass(field.annotation)
            else given.pop(field.name)
            for field in _fields(group)
            if is_dataclass(field.annotation) or field.name in given
        }
    )
