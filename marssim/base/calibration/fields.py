"""Numbers and matrices of calibration files, with one line that names file and field where something is wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np

LARGEST = 1e12  # of any number in a calibration
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def first_of(fields: Mapping[str, Any], names: Sequence[str]) -> str | None:
    """Return the first of some names that is a field and has a value; None if none is."""
    return next((name for name in names if fields.get(name) is not None), None)


def matrix(fields: Mapping[str, Any], names: str | Sequence[str], *shapes: tuple[int, ...]) -> np.ndarray:
    """Return a matrix of numbers.

    Args:
        fields: The file's fields. A matrix is a list, nested or flat, or a mapping with rows, cols and data, as OpenCV
            and ROS write it.
        names: Name of the field, or several, of which the first that is there counts.
        shapes: Shapes that the matrix may have. A flat list may have any of their numbers of values.

    Returns:
        float64, of one of the shapes.

    Raises:
        ValueError: The field is missing, has another shape, or a value that is no finite number.
    """
    name = first_of(fields, (names,) if isinstance(names, str) else names)
    if name is None:
        raise ValueError(f"field {names if isinstance(names, str) else ' or '.join(names)} is missing")
    values = fields[name]
    if isinstance(values, Mapping):
        rows, cols = values.get("rows"), values.get("cols")
        array = numbers(values.get("data"), name)
        if rows is not None or cols is not None:
            if type(rows) is not int or type(cols) is not int:  # bool is an int too
                raise ValueError(f"field {name} must have whole numbers of rows and cols")
            if rows < 0 or cols < 0 or array.size != rows * cols:
                raise ValueError(f"field {name} must have {rows} x {cols} numbers, has {array.size}")
            array = array.reshape(rows, cols)
    else:
        array = numbers(values, name)
    for shape in shapes:
        flat = array.ndim < 2 or 1 in array.shape
        if array.shape == shape or (flat and array.size == np.prod(shape)):
            return array.reshape(shape)
    wanted = " or ".join(" x ".join(map(str, shape)) for shape in shapes)
    raise ValueError(f"field {name} must be {wanted}, is {' x '.join(map(str, array.shape)) or 'one number'}")


def numbers(values: Any, name: str) -> np.ndarray:
    """Return numbers, as numbers or as text, in lists of any nesting.

    Args:
        values: The numbers.
        name: Name of the field, for the message.

    Raises:
        ValueError: Something is no finite number, or the lists are ragged.
    """
    if isinstance(values, str):
        values = values.split()
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"field {name} must hold numbers only") from None
    if not (np.abs(array) <= LARGEST).all():
        raise ValueError(f"field {name} has a value that is no finite number")
    return array


def read_in(
    place: object, read: Callable[_Arguments, _Result], *args: _Arguments.args, **flags: _Arguments.kwargs
) -> _Result:
    """Return what a function reads.

    Args:
        place: The file, or the part of a file, that it reads.
        read: The function.
        *args, **flags: Its arguments.

    Raises:
        ValueError: As the function does; the message begins with the place.
    """
    try:
        return read(*args, **flags)
    except ValueError as error:
        raise ValueError(message_in([place], error)) from None


def message_in(places: Sequence[object], error: ValueError) -> str:
    """Return the message of an error, with the places that it is about in front unless it begins with one of them."""
    message = str(error)
    if message.startswith(tuple(f"{place}{end}" for place in places for end in (": ", " and "))):
        return message
    return f"{' and '.join(map(str, places))}: {message}"


def size(fields: Mapping[str, Any], pairs: Sequence[str] = (), sides: Sequence[tuple[str, str]] = ()) -> Any:
    """Return width and height of the images that a file is for; None if it does not say.

    Args:
        fields: The file's fields.
        pairs: Names of a field with both.
        sides: Names of two fields.

    Raises:
        ValueError: A size is no positive whole number.
    """
    for name in pairs:
        if fields.get(name) is not None:
            return _whole(numbers(fields[name], name), name)
    for width, height in sides:
        if fields.get(width) is not None and fields.get(height) is not None:
            both = [numbers(fields[side], side) for side in (width, height)]
            return _whole(np.array([x.reshape(-1)[0] if x.size else 0 for x in both]), f"{width}, {height}")
    return None


def _whole(values: np.ndarray, name: str) -> tuple[int, int]:
    if values.shape != (2,) or not ((values >= 1) & (values < 1e6) & (values % 1 == 0)).all():
        raise ValueError(f"field {name} must be width and height of the images in pixels")
    return int(values[0]), int(values[1])
