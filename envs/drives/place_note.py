"""A place in the settings that a result folder keeps."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from marssim.scene.place_file import load_place
from marssim.scene.presets import PRESETS


def place_note(scene: str) -> dict[str, str]:
    """Return the place's settings as a result folder notes them.

    Args:
        scene: A preset, or the JSON file of a place.

    Returns:
        "scene", the name of the preset or of the file. For a file "scene_sha256" too, the SHA-256 of its place: another
        content under the same name is another place, whatever spaces the file has.
    """
    if scene in PRESETS:
        return {"scene": scene}
    place = asdict(load_place(scene))
    place["relief"].pop("heightmap")  # its digest stays: the file may have moved
    return {"scene": Path(scene).name, "scene_sha256": hashlib.sha256(json.dumps(place).encode()).hexdigest()}
