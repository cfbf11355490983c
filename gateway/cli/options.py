"""Options of a command that belong together, as one dataclass: each field is declared once, there."""

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args

import typer
from typer.models import OptionInfo

from gateway.options import Option


def takes_options(command: Callable[..., None]) -> Callable[..., None]:
    """Replace a command's dataclass parameters by options for their fields.

    A field that is a dataclass itself is replaced by its own fields. The annotations of the others are
    typer's, those of :mod:`gateway.options`, or declarations about table files.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        if is_dataclass(parameter.annotation):
            groups[name] = parameter.annotation
            parameters += [each.replace(kind=parameter.kind) for each in _options_of(parameter.annotation)]
        else:
            parameters.append(_typed(parameter))

    @wraps(command)
    def run(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = _filled(group, given)
        command(**given)

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
            yield _typed(field)
        else:
            yield from _of_table(field)


def _typed(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter in typer's form."""
    kind, *option = get_args(parameter.annotation) or (None,)
    if option and isinstance(option[0], Option):
        return parameter.replace(annotation=Annotated[kind, _of_program(parameter.name, option[0])])
    return parameter


def _of_program(field: str, option: Option) -> Any:
    name = option.name or field.replace("_", "-")
    words = option.one_of
    return typer.Option(
        f"--{name}",
        help=option.help,
        metavar=option.metavar,
        min=option.min,
        max=option.max,
        readable=not option.is_read_by_us,
        autocompletion=None if words is None else _completion(words),
        callback=None if words is None else _check(words),
    )


def _completion(words: Callable[[], Sequence[str]]) -> Callable[[str], list[str]]:
    def complete(incomplete: str) -> list[str]:
        return [word for word in words() if word.startswith(incomplete)]

    return complete


def _check(words: Callable[[], Sequence[str]]) -> Callable[[str | None], str | None]:
    def check(word: str | None) -> str | None:
        if word is not None and word not in words():
            raise typer.BadParameter(f"{word!r}: must be one of {', '.join(sorted(words()))}")
        return word

    return check


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
