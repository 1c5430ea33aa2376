"""Labels of PDS4 (XML) with a camera model of the geometry dictionary: geom:CAHV_Model, CAHVOR_Model, CAHVORE_Model."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.bounded_text import parse_xml, read_text
from marssim.base.calibration.cameras import PosedCamera, from_vectors
from marssim.base.calibration.lenses.cahvore import linearity_of
from marssim.base.calibration.product_label import (
    ProductLabel,
    eye_of,
    parse_counter,
    parse_time,
    pixel_constants,
    sample_type,
)  # fmt: skip
from marssim.base.calibration.zhurong import camera_of_zhurong, is_zhurong

VECTORS = {
    "Vector_Center": "position", "Vector_Axis": "unit", "Vector_Horizontal": "pixel", "Vector_Vertical": "pixel",
    "Vector_Optical": "unit",
}  # fmt: skip
TYPE = re.compile(r"(Unsigned|Signed|IEEE754)(?:[LM]SB)?(Byte|2|4|8|Single|Double)")  # of the elements of an array
KINDS = {"Unsigned": "u", "Signed": "i", "IEEE754": "f"}  # of numpy
SIZES = {"Byte": "1", "Single": "4", "Double": "8"}  # [bytes]
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}  # [m] units of positions


def read_pds4(path: Path) -> ProductLabel:
    """Read a label of PDS4, also one of Zhurong's (.2CL).

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The label is malformed. One line that names the file.
    """
    text = read_text(path, "label")
    try:
        root = parse_xml(text)
        if root.tag == "opencv_storage":
            raise ValueError("is a calibration of OpenCV, not a label of PDS4")
        size = _size(root)
        if is_zhurong(root):
            camera: PosedCamera | None = camera_of_zhurong(root, size)
        else:
            parameters = root.find(".//Camera_Model_Parameters")
            camera = None if parameters is None else _camera(parameters, size)
        counter = root.findall(".//Motion_Counter//index_value_number")
        names = [node.text for node in root.iterfind(".//Observing_System_Component/name")]
        constants = {
            kind: [node.text or "" for node in root.iterfind(f".//{kind}")]
            for kind in ("missing_constant", "invalid_constant")
        }
        return ProductLabel(
            camera, size,
            start=parse_time(root.findtext(".//start_date_time")),
            eye=eye_of(*names),
            motion=parse_counter(node.text for node in counter),
            missing=pixel_constants(constants, _sample_type(root)),
        )  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _size(root: Element) -> tuple[int, int] | None:
    """Return width and height of the first image; None if the label does not say."""
    for image in (node for kind in ("Array_2D_Image", "Array_3D_Image") for node in root.iter(kind)):
        axes = {str(axis.findtext("axis_name")): axis.findtext("elements") for axis in image.iter("Axis_Array")}
        return fields.size(axes, sides=[("Sample", "Line")])
    return None


def _sample_type(root: Element) -> np.dtype | None:
    """Return the type of a pixel, most significant byte first; None if the label does not say it."""
    match = TYPE.fullmatch((root.findtext(".//Element_Array/data_type") or "").strip())
    return None if match is None else sample_type(KINDS[match[1]], int(SIZES.get(match[2], match[2])))


def _camera(parameters: Element, size: tuple[int, int] | None) -> PosedCamera:
    kind = (parameters.findtext("model_type") or "").strip()
    model = parameters.find(f"{kind}_Model") if kind in ("CAHV", "CAHVOR", "CAHVORE") else None
    if model is None:
        raise ValueError(f"Camera_Model_Parameters: model_type {kind} is not supported; CAHV, CAHVOR and CAHVORE are")
    c, a, h, v = (_vector(model, name) for name in list(VECTORS)[:4])
    o = _vector(model, "Vector_Optical") if kind != "CAHV" else None
    r = _terms(model, "Radial_Terms") if kind != "CAHV" else (0.0, 0.0, 0.0)
    e, linearity = (0.0, 0.0, 0.0), 1.0
    if kind == "CAHVORE":
        e = _terms(model, "Entrance_Terms")
        values = {name: model.findtext(f"cahvore_model_{name}") or "0" for name in ("type", "parameter")}
        type_, parameter = (float(fields.matrix(values, name, (1,))[0]) for name in ("type", "parameter"))
        linearity = linearity_of(type_, parameter)
    space = parameters.find(".//Coordinate_Space_Indexed")
    frame = ""
    if space is not None:
        index = ",".join(node.text or "" for node in space.iter("index_value_number"))
        frame = f"{space.findtext('coordinate_space_frame_type') or ''} ({index})".strip()
    return from_vectors(c, a, h, v, o, r, e, linearity, size, frame)


def _vector(model: Element, name: str) -> np.ndarray:
    """Return a vector; a position in metres, whatever its unit in the label."""
    nodes = [model.find(f"{name}/{axis}_{VECTORS[name]}") for axis in "xyz"]
    vector = fields.matrix({name: [None if node is None else node.text for node in nodes]}, name, (3,))
    if VECTORS[name] != "position":
        return vector
    units = [node.get("unit", "m") for node in nodes if node is not None]
    if unknown := next((unit for unit in units if unit not in LENGTHS), None):
        raise ValueError(f"{name}: unit {unknown} is unknown; {', '.join(LENGTHS)} are known")
    return vector * [LENGTHS[unit] for unit in units]


def _terms(model: Element, name: str) -> tuple[float, float, float]:
    values = {name: [model.findtext(f"{name}/c{i}") for i in range(3)]}
    a, b, c = (float(x) for x in fields.matrix(values, name, (3,)))
    return a, b, c
