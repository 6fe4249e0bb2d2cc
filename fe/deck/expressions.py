"""Expressions of *PARAMETER: arithmetic and nothing else, so that a stranger's deck runs no code."""

import ast
import math
from collections.abc import Callable, Iterable, Mapping

LONGEST = 500  # letters of one expression
FUNCTIONS: dict[str, Callable[..., float]] = {
    name: getattr(math, name)
    for name in ("acos", "asin", "atan", "cos", "cosh", "exp", "log", "log10", "sin", "sinh", "sqrt", "tan",
                 "tanh")
} | {"abs": abs, "max": max, "min": min, "int": math.trunc, "float": float}  # fmt: skip
OPERATORS: dict[type, Callable[..., float]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Mod: lambda a, b: a % b,
    ast.Pow: lambda a, b: math.pow(a, b),  # of floats: a power of large integers would never end
    ast.UAdd: lambda a: a,
    ast.USub: lambda a: -a,
}


def value_of(text: str, parameters: Mapping[str, float | str]) -> float | str:
    """Value of an expression of *PARAMETER: a number, or a quoted text. Numbers may be combined by + - * / **
    %, brackets, FUNCTIONS and the names in `parameters`. ValueError says what is wrong with the expression.

    >>> value_of("2*radius + sqrt(0.25)", {"radius": 3.0})
    6.5
    """
    if len(text) > LONGEST:
        raise ValueError(f"an expression of {len(text)} letters: wanted at most {LONGEST}")
    try:
        value = _value(ast.parse(text.strip(), mode="eval").body, parameters)
    except SyntaxError:
        raise ValueError(f"{text.strip()}: wanted an expression such as 2*radius + 0.5") from None
    except (ArithmeticError, TypeError, RecursionError) as error:
        raise ValueError(f"{text.strip()}: cannot be computed ({error})") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{text.strip()}: wanted a finite number")
    return value


def _value(node: ast.expr, parameters: Mapping[str, float | str]) -> float | str:
    match node:
        case ast.Constant(value=int() | float() | str() as value) if not isinstance(value, bool):
            return value if isinstance(value, str) else _number(value)
        case ast.Name(id=name) if name.lower() in parameters:
            return parameters[name.lower()]
        case ast.Name(id="pi"):
            return math.pi
        case ast.BinOp(left=a, op=op, right=b) if type(op) in OPERATORS:
            return OPERATORS[type(op)](*_numbers((a, b), parameters))
        case ast.UnaryOp(op=op, operand=a) if type(op) in OPERATORS:
            return OPERATORS[type(op)](*_numbers((a,), parameters))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name.lower() in FUNCTIONS:
            return _called(FUNCTIONS[name.lower()], _numbers(args, parameters))
        case ast.Name(id=name):
            raise ValueError(f"the parameter {name} is not defined above; define it under *PARAMETER")
    raise ValueError(
        f"{ast.unparse(node)[:60]}: wanted numbers, + - * / **, brackets, {', '.join(FUNCTIONS)}"
    )


def _numbers(nodes: Iterable[ast.expr], parameters: Mapping[str, float | str]) -> list[float]:
    """Values of expressions as numbers. TypeError for a text, which multiplied would fill the memory."""
    values = [_value(node, parameters) for node in nodes]
    if any(isinstance(x, str) for x in values):
        raise TypeError("a text among numbers")
    return values  # type: ignore[return-value]


def _called(function: Callable[..., float], values: list[float]) -> float:
    try:
        return function(*values)
    except ValueError as error:  # math's: the root of a negative number
        raise ArithmeticError(str(error)) from None


def _number(value: int | float) -> float:
    """Whole numbers stay whole as long as they are exact as floats."""
    return value if abs(value) < 2**53 else float(value)
