"""Signatures of the commands, read from the source of their functions; no command is imported.

So help, a wrong option and `import twin.notebook` need not wait for the numerical libraries of a command.
"""

import ast
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from typer import Argument, Option
from typer.models import OptionInfo

from twin.chain import Command

METAVARS = {str: "TEXT", float: "NUMBER", int: "NUMBER", Path: "PATH"}
# The names that the annotation of an option may use:
NAMES = {"Annotated": Annotated, "Argument": Argument, "Option": Option, "Path": Path, "Sequence": Sequence}


@dataclass(frozen=True)
class CommandSignature:
    """The options of a command, and the docstring of its function."""

    parameters: tuple[Parameter, ...]  # what a user states, each Annotated with a typer Option or Argument
    doc: str

    @property
    def parser(self) -> list[Parameter]:
        """The parameters as the parser takes them: keyword-only, sequences as lists."""
        return [
            p.replace(kind=Parameter.KEYWORD_ONLY, annotation=_as_list(p.annotation),
                      default=[] if p.default == () else p.default)
            for p in self.parameters
        ]  # fmt: skip

    @property
    def method(self) -> Signature:
        """The signature of the method of a project: a first sequence is typed as `*names`."""
        self_parameter = Parameter("self", Parameter.POSITIONAL_ONLY)
        return Signature([self_parameter, *(_as_argument(p) for p in self.parameters)])

    @property
    def helps(self) -> dict[str, str]:
        """The help of each option by its name."""
        return {p.name: str(get_args(p.annotation)[1].help) for p in self.parameters}


@cache
def signature_of(command: Command) -> CommandSignature:
    """The signature of a command.

    >>> from twin.chain import command_of
    >>> signature_of(command_of("profile")).method
    <Signature (self, /, *names: str)>
    """
    module, _, name = command.function.partition(":")
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    function = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name)
    arguments = function.args
    at_the_end = [None] * (len(arguments.args) - len(arguments.defaults)) + list(arguments.defaults)
    kinds = [*(Parameter.POSITIONAL_OR_KEYWORD for _ in arguments.args),
             *(Parameter.KEYWORD_ONLY for _ in arguments.kwonlyargs)]  # fmt: skip
    rows = zip(
        kinds, [*arguments.args, *arguments.kwonlyargs], [*at_the_end, *arguments.kw_defaults], strict=True
    )
    parameters = tuple(
        Parameter(argument.arg, kind, annotation=_value(argument.annotation),
                  default=Parameter.empty if default is None else _value(default))
        for kind, argument, default in rows
        if _is_option(argument.annotation)
    )  # fmt: skip
    return CommandSignature(parameters, inspect.cleandoc(ast.get_docstring(function) or ""))


def _is_option(annotation: ast.expr | None) -> bool:
    return isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) == "Annotated"


def _value(expression: ast.expr | None) -> Any:
    assert expression is not None
    return eval(compile(ast.Expression(expression), "<signature>", "eval"), dict(NAMES))


def _as_list(annotation: Any) -> Any:
    kind, option = get_args(annotation)[:2]
    if isinstance(option, OptionInfo):  # an argument shows its name
        option.metavar = next((METAVARS[k] for k in (kind, *get_args(kind)) if k in METAVARS), None)
    return Annotated[list[get_args(kind)[0]] if _is_sequence(kind) else kind, option]  # type: ignore[misc]


def _as_argument(parameter: Parameter) -> Parameter:
    kind = get_args(parameter.annotation)[0]
    if parameter.kind is Parameter.POSITIONAL_OR_KEYWORD and _is_sequence(kind):
        return Parameter(parameter.name, Parameter.VAR_POSITIONAL, annotation=get_args(kind)[0])
    return parameter.replace(annotation=kind)


def _is_sequence(kind: Any) -> bool:
    return get_origin(kind) is Sequence


def called_with(signature: Signature, call: Callable[..., Any], /) -> Callable[..., Any]:
    """A function with this signature that calls `call(self, **options)`; texts are taken as paths, too."""

    def method(*given: Any, **options: Any) -> Any:
        bound = signature.bind(*given, **options)
        bound.apply_defaults()
        (_, opened), *rest = bound.arguments.items()
        kinds = {p.name: p.annotation for p in signature.parameters.values()}
        return call(opened, **{name: _as_path(value, kinds[name]) for name, value in rest})

    method.__signature__ = signature  # type: ignore[attr-defined]
    return method


def _as_path(value: Any, kind: Any) -> Any:
    if isinstance(value, str) and (kind is Path or Path in get_args(kind)):
        return Path(value)
    if isinstance(value, tuple) and kind is Path:
        return tuple(map(Path, value))
    return value
