"""Labels of PDS3 (in ODL) and of VICAR, attached to an image or in a file of their own.

Only what is needed is read: groups and objects of keys with numbers, text and tuples. Sources: PDS3 Standards
Reference, chapter 12 (ODL); the VICAR file format, "The labels".
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.bounded_text import MOST_BYTES
from marssim.base.calibration.cameras import PosedCamera, from_vectors
from marssim.base.calibration.lenses.cahvore import Cahvore, linearity_of
from marssim.base.calibration.product_label import (
    ProductLabel,
    eye_of,
    parse_counter,
    parse_time,
    pixel_constants,
    sample_type,
)  # fmt: skip
from marssim.base.command.input_file import check_file

MODEL = "GEOMETRIC_CAMERA_MODEL"  # of Mars 2020 and MER
MODEL_NAMES = (MODEL, "GEOMETRIC_CAMERA_MODEL_PARMS")  # and of MSL
MODELS = ("CAHV", "CAHVOR", "CAHVORE")
KINDS = {"REAL": "f", "UNSIGNED": "u", "INTEGER": "i"}  # of numpy, by a word in SAMPLE_TYPE, of which the first counts
FILE_BYTES = "file bytes"  # the size of a file with a VICAR label; with its space, no key of a label has this name
SIZES = {"8": 1, "16": 2, "32": 4, "64": 8}  # [bytes] by SAMPLE_BITS
_VALUE = r'"[^"]*"|\((?:[^()"]|"[^"]*"|\((?:[^()"]|"[^"]*")*\))*\)|\{[^{}]*\}|[^\r\n]*'
# Possessive, and no list begins in another one: what does not match is given up in one pass over it.
_STATEMENT = re.compile(rf"^[ \t]*+(\^?[A-Za-z][\w:]*+)[ \t]*+(?:=\s*+({_VALUE}))?[ \t]*+\r?$", re.MULTILINE)
_VICAR = re.compile(r"(?<!\w)([A-Za-z]\w*+)\s*+=\s*+('(?:[^']|'')*+'|\([^()]*+\)|[^\s']+)")
_END = re.compile(rb"^[ \t]*END[ \t]*\r?$", re.MULTILINE)
_QUOTE_OR_COMMENT = re.compile(r'"|/\*')
_ITEM = re.compile(r'"[^"]*"|\'[^\']*\'|[^,()"\']+')
_UNIT = re.compile(r"<[^<>]*>")
_POINTER = re.compile(r"(\d+)\s*(<\s*BYTES\s*>)?")  # to a record, or to a byte, of the file itself


def is_pds3(head: bytes) -> bool:
    """Return whether a file that begins so has a label of PDS3 or VICAR."""
    start = head.lstrip()
    return start.startswith((b"ODL_VERSION_ID", b"PDS_VERSION_ID", b"LBLSIZE=")) or MODEL.encode() in head


def read_pds3(path: Path) -> ProductLabel:
    """Read a label of PDS3 or VICAR.

    Args:
        path: The image with its label, or the label alone.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The label is malformed, or its camera model is no CAHV, CAHVOR or CAHVORE. One line that names it.
    """
    check_file(path, "image or label")
    with path.open("rb") as file:
        data = file.read(MOST_BYTES)
    try:
        if data.startswith(b"LBLSIZE="):
            return _product(_vicar(data), attached=True)
        end = _END.search(data)
        if end is None:
            raise ValueError("has a label without an end: is the file truncated?")
        label = _odl(data[: end.start()].decode("latin-1"))
        return _product(label, attached=_POINTER.fullmatch(str(label.get("^IMAGE", ""))) is not None)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def camera_group(camera: PosedCamera) -> str:
    """Return the group GEOMETRIC_CAMERA_MODEL of a camera with a CAHVORE lens, as text for a PDS3 label.

    Args:
        camera: The camera. The vectors are in the frame of its rig.

    Raises:
        ValueError: The lens is of another kind.
    """
    lens = camera.lens
    if not isinstance(lens, Cahvore):
        raise ValueError(f"a lens of kind {type(lens).__name__} has no vectors C, A, H, V, O, R and E")
    vectors = [camera.centre, *(np.array(x) @ camera.rotation for x in (lens.a, lens.h, lens.v, lens.o))]
    kind = {1.0: 1, 0.0: 2}.get(lens.linearity, 3)
    lines = [f"GROUP = {MODEL}", "  MODEL_TYPE = CAHVORE", '  MODEL_COMPONENT_ID = ("C","A","H","V","O","R","E")']
    for number, vector in enumerate([*vectors, lens.r, lens.e], 1):
        lines.append(f"  MODEL_COMPONENT_{number} = ({','.join(repr(float(x)) for x in vector)})")
    lines += [f"  MODEL_COMPONENT_8 = {kind:.1f}", f"  MODEL_COMPONENT_9 = {lens.linearity if kind == 3 else 0.0!r}"]
    return "\n".join([*lines, f'  REFERENCE_COORD_SYSTEM_NAME = "{camera.frame}"', f"END_GROUP = {MODEL}"]) + "\n"


def label_text(camera: PosedCamera) -> str:
    """Return a detached label with the camera model of a camera and the size of its images, as camera_group writes it.

    Raises:
        ValueError: The lens is of another kind, or the camera has no size.
    """
    if camera.size is None:
        raise ValueError("a label needs the size of the images")
    width, height = camera.size
    image = f"OBJECT = IMAGE\n  LINES = {height}\n  LINE_SAMPLES = {width}\nEND_OBJECT = IMAGE\n"
    return f"PDS_VERSION_ID = PDS3\n{camera_group(camera)}{image}END\n"


def _odl(text: str) -> dict[str, Any]:
    """Return the keys of a label, with groups and objects as dicts; the first of two of one name counts.

    Pointers to data (^IMAGE) keep their units.
    """
    root: dict[str, Any] = {}
    stack = [root]
    for key, value in _STATEMENT.findall(_without_comments(text)):
        if key in ("GROUP", "OBJECT"):
            inner: dict[str, Any] = {}
            stack[-1].setdefault(value.strip().strip('"'), inner)
            stack.append(inner)
        elif key in ("END_GROUP", "END_OBJECT"):
            if len(stack) > 1:
                stack.pop()
        else:
            stack[-1].setdefault(key, value.strip() if key.startswith("^") else _plain(value))
    return root


def _without_comments(text: str) -> str:
    """Return a label without its comments, /* ... */. One without an end is none, nor is one within quotes."""
    parts, kept, at = [], 0, 0
    while begins := _QUOTE_OR_COMMENT.search(text, at):
        mark = begins[0]
        end = text.find('"' if mark == '"' else "*/", begins.end())
        if end < 0 and mark != '"':
            break
        at = begins.end() if end < 0 else end + len(mark)
        if mark != '"':
            parts.append(text[kept : begins.start()])
            kept = at
    return "".join(parts) + text[kept:]


def _vicar(data: bytes) -> dict[str, Any]:
    """Return the keys of a VICAR label under the names of PDS3's; its properties are groups."""
    size = re.match(rb"LBLSIZE=(\d+)", data)
    if size is None or int(size[1]) > len(data):
        raise ValueError("has a label that is longer than the file: is the file truncated?")
    root: dict[str, Any] = {}
    group: dict[str, Any] = root
    for key, value in _VICAR.findall(data[: int(size[1])].decode("latin-1")):
        plain = _plain(value)
        if key in ("PROPERTY", "TASK"):
            group = {}
            if key == "PROPERTY" and isinstance(named := root.setdefault(str(plain), group), dict):
                group = named
        else:
            group.setdefault(key, plain)
    try:
        lines, samples, record = (int(root[name]) for name in ("NL", "NS", "RECSIZE"))
        bands, header = int(root.get("NB", 1)), int(root.get("NLB", 0))
    except (KeyError, TypeError, ValueError):
        raise ValueError("has a VICAR label without the size of the image (NL, NS, RECSIZE)") from None
    label: dict[str, Any] = {key: value for key, value in root.items() if isinstance(value, dict)}
    for identification in ("IDENTIFICATION", "INSTRUMENT_STATE_PARMS"):
        label.update({k: v for k, v in _group(root, identification).items() if k not in label})
    label["IMAGE"] = {"LINES": str(lines), "LINE_SAMPLES": str(samples), **_group(root, "IMAGE_DATA")}
    label[FILE_BYTES] = int(size[1]) + record * (header + lines * bands)
    return label


def _group(label: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a group of a label; an empty one if there is none, or a value has its name."""
    group = label.get(name)
    return group if isinstance(group, dict) else {}


def _plain(value: str) -> Any:
    """Return a value without quotes and units: text, or a list of texts."""
    value = _UNIT.sub("", value.strip())
    if value.startswith(("(", "{")):
        return [item.strip().strip("\"'").strip() for item in _ITEM.findall(value.strip("{}")) if item.strip()]
    return " ".join(value.strip().strip("\"'").split())


def _product(label: dict[str, Any], attached: bool) -> ProductLabel:
    image = _group(label, "IMAGE")
    size = fields.size(image, sides=[("LINE_SAMPLES", "LINES")])
    model = next((label[name] for name in MODEL_NAMES if isinstance(label.get(name), dict)), None)
    counter = label.get("ROVER_MOTION_COUNTER", [])
    constants: dict[str, Any] = {key: image[key] for key in ("MISSING_CONSTANT", "INVALID_CONSTANT") if key in image}
    return ProductLabel(
        camera=None if model is None else _camera(model, size),
        size=size,
        start=parse_time(label.get("START_TIME") or label.get("IMAGE_TIME")),
        eye=eye_of(label.get("FRAME_ID"), label.get("INSTRUMENT_ID"), label.get("INSTRUMENT_NAME")),
        motion=parse_counter(counter),
        missing=pixel_constants(constants, _sample_type(image)),
        file_bytes=label.get(FILE_BYTES) or (_file_bytes(label, image) if attached else None),
    )


def _sample_type(image: dict[str, Any]) -> np.dtype | None:
    """Return the type of a pixel, most significant byte first; None if the label does not say it."""
    name, size = str(image.get("SAMPLE_TYPE", "")).upper(), SIZES.get(str(image.get("SAMPLE_BITS", "")))
    kind = next((code for word, code in KINDS.items() if word in name and "VAX" not in name), None)
    return sample_type(kind, size)


def _file_bytes(label: dict[str, Any], image: dict[str, Any]) -> int | None:
    """Return how many bytes a file must have to hold its image; None if the label does not say."""
    try:
        pointer = _POINTER.fullmatch(label["^IMAGE"])
        assert pointer is not None
        start = (int(pointer[1]) - 1) * (1 if pointer[2] else int(label["RECORD_BYTES"]))
        lines, samples, bits = (int(image[name]) for name in ("LINES", "LINE_SAMPLES", "SAMPLE_BITS"))
        return start + lines * samples * int(image.get("BANDS", 1)) * bits // 8
    except (KeyError, TypeError, ValueError):
        return None


def _camera(model: dict[str, Any], size: tuple[int, int] | None) -> PosedCamera:
    """Return the camera of a group GEOMETRIC_CAMERA_MODEL, with components in the order of MODEL_TYPE's letters."""
    kind = model.get("MODEL_TYPE")
    if kind not in MODELS:
        raise ValueError(f"{MODEL}: MODEL_TYPE {kind} is not supported; {', '.join(MODELS)} are")
    components = {name: f"MODEL_COMPONENT_{number}" for number, name in enumerate(str(kind), 1)}
    try:
        vectors = {name: fields.matrix(model, field, (3,)) for name, field in components.items()}
        linearity = 1.0
        if kind == "CAHVORE":
            type_, parameter = (float(fields.matrix(model, f"MODEL_COMPONENT_{n}", (1,))[0]) for n in (8, 9))
            linearity = linearity_of(type_, parameter)
        zero = (0.0, 0.0, 0.0)
        r, e = (tuple(float(x) for x in vectors.get(name, zero)) for name in "RE")
        frame = f"{model.get('REFERENCE_COORD_SYSTEM_NAME', '')} {_index(model)}".strip()
        c, a, h, v = (vectors[name] for name in "CAHV")
        return from_vectors(c, a, h, v, vectors.get("O"), r, e, linearity, size, frame)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f"{MODEL}: {error}") from None


def _index(model: dict[str, Any]) -> str:
    index = model.get("REFERENCE_COORD_SYSTEM_INDEX", [])
    return f"({','.join(index)})" if isinstance(index, list) and index else ""
