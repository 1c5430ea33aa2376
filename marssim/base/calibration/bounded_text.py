"""Parsers for untrusted YAML, JSON and XML, with limits on size and depth; nothing in the file is executed.

OpenCV's own parser ends the process on deeply nested files, so its files are read here too.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import yaml

from marssim.base.command.input_file import check_file
from marssim.base.files.json_file import is_deeper

MOST_BYTES = 4_000_000  # calibrations have some kB, the labels of images up to 500 kB
MOST_LEVELS = 40  # of nesting
TOO_DEEP = "is nested too deeply"
_EVENTS = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_EVENTS):  # type: ignore[misc, valid-type]
    """PyYAML's safe loader, which also takes the types of OpenCV's matrices for what they are, mappings."""


_Loader.add_multi_constructor(
    "tag:yaml.org,2002:opencv-", lambda loader, tag, node: loader.construct_mapping(node, deep=True)
)


def read_text(path: Path, what: str = "calibration file", most: int = MOST_BYTES) -> str:
    """Read an untrusted text file.

    Args:
        path: The file.
        what: Kind of file, for the messages.
        most: Largest size that it may have [bytes].

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is too large, or is no text. One line that names it.
    """
    check_file(path, what)
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"{path}: has more than {most // 1_000_000} MB, which no {what} has")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not a text file ({error.reason}), as a {what} is") from None


def parse_yaml(text: str) -> dict[str, Any]:
    """Parse YAML, also OpenCV's, whose header is not YAML's.

    Raises:
        ValueError: The text is no mapping in YAML, has aliases, or is nested too deeply.
    """
    text = re.sub(r"\A%YAML[^\n]*\n", "", text)
    level = 0
    try:
        for event in yaml.parse(text, Loader=_EVENTS):
            if isinstance(event, yaml.AliasEvent):
                raise ValueError("has aliases (*), which calibrations do without")
            if isinstance(event, yaml.CollectionStartEvent):
                level += 1
            elif isinstance(event, yaml.CollectionEndEvent):
                level -= 1
            if level > MOST_LEVELS:
                raise ValueError(TOO_DEEP)
        content = _load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise ValueError(f"is not YAML{where}: {getattr(error, 'problem', None) or 'not readable'}") from None
    except (RecursionError, MemoryError, OverflowError):
        raise ValueError(TOO_DEEP) from None
    return _mapping(content, "YAML")


def _load(text: str) -> Any:
    """Return the content of YAML. Raises ValueError, or YAMLError."""
    try:
        return yaml.load(text, Loader=_Loader)
    except (ValueError, LookupError, AttributeError, TypeError):  # of "x: !!int ''" and "x: !!bool maybe"
        raise ValueError("is not YAML: a value is not of the type that its tag (!!) says") from None


def parse_json_text(text: str) -> dict[str, Any]:
    """Parse JSON.

    Raises:
        ValueError: The text is no object in JSON, or is nested too deeply.
    """
    try:
        content = json.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    except ValueError as error:
        raise ValueError(f"is not JSON: {error}") from None
    if is_deeper(content, MOST_LEVELS):
        raise ValueError(TOO_DEEP)
    return _mapping(content, "JSON")


def parse_xml(text: str) -> Element:
    """Parse XML without document types, and so without entities.

    Raises:
        ValueError: The text is not XML, has a document type, or is nested too deeply.
    """
    builder, level = TreeBuilder(), 0
    parser = expat.ParserCreate(namespace_separator="}")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal level
        level += 1
        if level > MOST_LEVELS:
            raise ValueError(TOO_DEEP)
        builder.start(tag.rpartition("}")[2], attributes)

    def end(tag: str) -> None:
        nonlocal level
        level -= 1
        builder.end(tag.rpartition("}")[2])

    def refuse(*_: object) -> None:
        raise ValueError("has a document type (<!DOCTYPE), which calibrations do without")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.encode(), True)
    except (expat.ExpatError, LookupError) as error:  # LookupError: the encoding that it names is unknown
        raise ValueError(f"is not XML: {error}") from None
    return builder.close()


def _mapping(content: Any, kind: str) -> dict[str, Any]:
    if not isinstance(content, Mapping):
        raise ValueError(f"is not a mapping of names to values in {kind}")
    return {str(key): value for key, value in content.items()}
