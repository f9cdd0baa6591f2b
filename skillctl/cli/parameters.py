"""From the options that the rooms declare to those that the command line takes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Annotated, Any, Literal, Optional, get_args

import typer

from skillctl.options import Declared, Option, options_of


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command in which dataclasses of options have become these options, one each.

    A parameter ``reading: Reading`` becomes ``--columns``, ``--dt`` and so on, and the command is called with
    the ``Reading`` that they make. ``Annotated[Reading, "Fitting to a task"]`` shows them under that heading.
    """
    signature = inspect.signature(command, eval_str=True)
    parameters: list[inspect.Parameter] = []
    records: dict[str, Any] = {}
    for parameter in signature.parameters.values():
        kind, *more = get_args(parameter.annotation) or [parameter.annotation]
        if hasattr(kind, "__dataclass_fields__"):
            records[parameter.name] = kind
            parameters += [p for each in options_of(kind) for p in _parameters(each, *more)]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    def call(**values: Any) -> None:
        made = {name: _made(kind, values) for name, kind in records.items()}
        command(**values, **made)

    call.__doc__ = command.__doc__
    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call


def _made(kind: Any, values: dict[str, Any]) -> Any:
    """Return an instance of a dataclass, and take what it is made of out of the values."""
    fields: dict[str, Any] = {}
    for each in options_of(kind):
        if each.option.named:
            given = {one.name: (values.pop(one.name), one.default) for one in each.option.named}
            fields[each.field] = {name: value for name, (value, default) in given.items() if value != default}
            continue
        value = values.pop(each.field)
        fields[each.field] = tuple(value or ()) if each.option.repeated else value
    return kind(**fields)


def _parameters(declared: Declared, heading: str | None = None) -> Iterable[inspect.Parameter]:
    """Yield what Typer makes one option of, or several for one that is several numbers by name."""
    option = replace(declared.option, group=heading or declared.option.group)
    if not option.named:
        default = None if option.repeated else declared.default
        yield _parameter(declared.field, declared.key, _kind(declared), default, option)
    for one in option.named:
        shown = replace(option, help=one.help, metavar=one.name[:1].upper())
        yield _parameter(one.name, one.name.replace("_", "-"), float, one.default, shown)


def _parameter(name: str, key: str, kind: Any, default: Any, option: Option) -> inspect.Parameter:
    info = typer.Option(
        *filter(None, (f"--{key}", option.short)),
        metavar=option.metavar,
        help=option.help,
        parser=option.read and parser(option.read),
        envvar=option.environment,
        rich_help_panel=option.group,
    )
    default = inspect.Parameter.empty if option.required else default
    keyword = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, keyword, annotation=Annotated[kind, info], default=default)


def _kind(declared: Declared) -> Any:
    """Return the type for Typer: a value that a function of ours reads can be of any type."""
    if declared.option.repeated:
        entry: Any = Any if declared.option.read else get_args(declared.kind)[0]
        return Optional[list.__class_getitem__(entry)]  # noqa: UP045  # made at run time
    if declared.option.read:
        return Any
    if declared.choices:
        return Optional[Literal[declared.choices]]  # noqa: UP045
    return declared.kind


def was_typed(context: Any, name: str) -> bool:
    """Return whether a parameter was given on the command line, even with its default."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def parser(read: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a reader whose ValueError the parser reports with the name of the option."""

    def parse(text: str) -> Any:
        try:
            return read(text)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return parse
