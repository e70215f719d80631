"""Check the arguments of public functions and classes by their annotations, and name the one that is wrong.

Functions that a loop calls for every sample are not decorated: they check what their kernels report.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial, wraps
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from aerobat_pin.errors import ArgumentError, ShapeError
from aerobat_pin.numerics.arrays import LARGEST_REAL, checked_shape, real_numbers, shown

Target = TypeVar("Target", bound=Callable[..., Any])
Shape = tuple[Any, ...]  # as `checked_shape` reads it; a name stands for one size in a whole call
Rule = Shape | list[Shape] | Literal["positive", "not negative", "any", "free"]
# Takes value, name and sizes so far; returns what the function gets.
ArgumentCheck = Callable[[Any, str, dict[Any, Any]], Any]


class _Numbers:
    """Stands for `Array` and `ArrayLike` when annotations are read."""


ALIASES = {"Array": _Numbers, "ArrayLike": _Numbers, "AlongSpan": Any}  # the last is checked where it is read
WORDS: dict[Any, str] = {str: "text", Path: "a path", float: "a number", Mapping: "a mapping"}


def guarded(**rules: Rule) -> Callable[[Target], Target]:
    """Check every call of a function, or of a class, against its annotations.

    Numbers are real, finite and of a size that occurs in SI units; arrays also arrive as arrays of doubles.

    Args:
        rules: argument -> its shape, or a list of the shapes that it can have; or the sign of a number; or `any` for
            numbers whose size the function checks, and `free` for an argument that the function checks.

    Raises:
        ArgumentError: on a call, if an argument has the wrong type.
        ShapeError: on a call, if an argument has the wrong shape, or holds a number that is not allowed.
    """

    def decorate(target: Target) -> Target:
        if isinstance(target, type):
            setattr(target, "__init__", _wrapped(getattr(target, "__init__"), rules))  # noqa: B009, B010
            return target
        return cast(Target, _wrapped(target, rules))

    return decorate


def _wrapped(function: Callable[..., Any], rules: Mapping[str, Rule]) -> Callable[..., Any]:
    names = tuple(inspect.signature(function).parameters)

    @cache
    def checks() -> dict[str, ArgumentCheck]:  # on the first call, when all modules are imported
        return {name: _check_of(hint, rules.get(name)) for name, hint in _hints(function).items() if name in names}

    @wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        known, sizes = checks(), dict[Any, Any]()
        values = [
            known[name](value, name, sizes) if name in known else value
            for name, value in zip(names, given, strict=False)
        ]
        checked = {name: known[name](value, name, sizes) if name in known else value for name, value in named.items()}
        return function(*values, *given[len(values) :], **checked)

    return call


def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the annotations of a function; those whose names only type checkers import are left out."""
    hints = {}
    for name, annotation in inspect.get_annotations(function).items():
        try:
            scope = getattr(inspect.unwrap(function), "__globals__", {})
            hints[name] = eval(annotation, scope, ALIASES) if isinstance(annotation, str) else annotation
        except NameError:
            continue
    return hints


def _check_of(hint: Any, rule: Rule | None = None) -> ArgumentCheck:
    """Return the check of one annotation."""
    kind, parts = get_origin(hint) or hint, get_args(hint)
    if rule == "free" or hint is Any:
        return _anything
    if hint is float:
        sign: Any = rule
        return lambda value, name, _: number(value, name, sign)
    if hint is _Numbers or kind is np.ndarray:
        return partial(_array, shape=rule)
    if kind is Literal:
        return _only(
            lambda value: isinstance(value, str | int) and value in parts, f"one of {', '.join(map(str, parts))}"
        )
    if kind in (Union, UnionType):
        return _one_of(parts, rule)
    if kind is tuple and parts and set(parts) <= {float, Ellipsis}:
        return partial(_array, shape=None if Ellipsis in parts else (len(parts),), keep=True)
    if kind is tuple and parts and Ellipsis not in parts:
        return partial(_row_of, items=[_check_of(part, rule) for part in parts])
    if kind in (Sequence, Iterable, tuple, list):
        return partial(_items, item=_check_of(parts[0] if parts else Any, rule), kept=kind is not Iterable)
    if kind is Mapping or kind is dict:
        return partial(
            _table, key=parts[0] if parts else object, item=_check_of(parts[1], rule) if parts else _anything
        )
    if kind is type:
        base = parts[0]
        return _only(lambda value: isinstance(value, type) and issubclass(value, base), f"a class of {base.__name__}")
    if kind is Callable or inspect.isfunction(kind):
        return _only(callable, "a function")
    if kind is int:
        return _whole_number
    if not isinstance(kind, type):
        return _anything
    return _only(lambda value: isinstance(value, kind), _word(kind))


def _word(kind: type) -> str:
    return WORDS.get(kind, f"a {kind.__name__}")


def _wrong(name: str, value: Any, expected: str) -> ArgumentError:
    return ArgumentError(f"{name} = {shown(value)}: {expected} was expected")


def _anything(value: Any, name: str, sizes: dict[Any, Any]) -> Any:
    return value


def number(value: Any, name: str, sign: Literal["positive", "not negative", "any"] | None = None) -> float:
    """Return a number as a float. Raises ArgumentError or ShapeError with its name if it is none, or not allowed."""
    array = real_numbers(value, name)
    if array.shape != ():
        raise ShapeError(f"{name} has shape {array.shape}: one number was expected")
    good = {"positive": array > 0.0, "not negative": array >= 0.0}.get(sign or "", True)
    if sign != "any" and not (good and abs(array) <= LARGEST_REAL):
        raise ShapeError(f"{name} = {array}: a finite number{'' if sign is None else f', {sign},'} was expected")
    return float(array)


def _array(value: Any, name: str, sizes: dict[Any, Any], shape: Any = None, keep: bool = False) -> Any:
    array = real_numbers(value, name)
    if shape is not None and shape != "any":
        checked_shape(array, shape, name, sizes)
    if shape != "any" and array.size and not (array.min() >= -LARGEST_REAL and array.max() <= LARGEST_REAL):
        if array.shape == ():
            raise ShapeError(f"{name} = {array}: a finite number was expected")
        raise ShapeError(
            f"{name} holds NaN, infinity or a number beyond {LARGEST_REAL:g}: finite numbers were expected"
        )
    return value if keep else array


def _one_of(parts: tuple[Any, ...], rule: Rule | None) -> ArgumentCheck:
    """Return the check of a union: the first member that fits counts; of the errors, the last is raised.

    Where all members are classes but numbers, the error names them all.
    """
    kinds = [part for part in parts if part is not type(None)]
    members = [_check_of(part, rule) for part in kinds]
    classes = [part for part in kinds if isinstance(part, type) and part not in (float, int)]
    optional = len(members) < len(parts)

    def check(value: Any, name: str, sizes: dict[Any, Any]) -> Any:
        if value is None and optional:
            return value
        for member in members[:-1]:
            try:
                return member(value, name, sizes)
            except (ArgumentError, ShapeError):
                continue
        try:
            return members[-1](value, name, sizes)
        except ArgumentError:
            if len(classes) < len(members):
                raise
            raise _wrong(name, value, " or ".join(map(_word, classes))) from None

    return check


def _items(value: Any, name: str, _: dict[Any, Any], item: ArgumentCheck, kept: bool = True) -> Any:
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0:
        raise _wrong(name, value, "a list")
    items = value if kept and isinstance(value, Sequence) else list(value)
    for i, element in enumerate(items):
        item(element, f"{name}[{i}]", {})
    return items


def _row_of(value: Any, name: str, _: dict[Any, Any], items: list[ArgumentCheck]) -> Any:
    elements = _items(value, name, {}, _anything)
    if len(elements) != len(items):
        raise ArgumentError(f"{name} has {len(elements)} items: {len(items)} were expected")
    for i, (item, element) in enumerate(zip(items, elements, strict=True)):
        item(element, f"{name}[{i}]", {})
    return elements


def _table(value: Any, name: str, _: dict[Any, Any], key: Any, item: ArgumentCheck) -> Any:
    if not isinstance(value, Mapping) or not all(isinstance(entry, key) for entry in value):
        raise _wrong(name, value, "a mapping from names" if key is str else "a mapping")
    return {entry: item(inside, f"{name}[{entry!r}]", {}) for entry, inside in value.items()}


def _only(fits: Callable[[Any], bool], expected: str) -> ArgumentCheck:
    """Return the check that a value fits, and stays as it is."""

    def check(value: Any, name: str, _: dict[Any, Any]) -> Any:
        if not fits(value):
            raise _wrong(name, value, expected)
        return value

    return check


def _whole_number(value: Any, name: str, _: dict[Any, Any]) -> Any:
    if isinstance(value, float):
        raise ShapeError(f"{name} = {value}: a whole number was expected")
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or abs(value) >= 2**63:
        raise _wrong(name, value, "a whole number")
    return value
