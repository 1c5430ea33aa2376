"""The page of a recorded drive: one HTML file that needs no server, no network and no other file.

Its content security policy forbids every request, and all that a record holds is put in as data, never as markup.
"""

from __future__ import annotations

import zlib
from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from envs.drives.colours import OUTCOME_COLOURS
from envs.drives.episodes import Cause
from envs.recording.code_colours import code_colours
from envs.recording.failure_cause import IN_WORDS
from envs.recording.page_colours import colour_rules
from envs.recording.turning_point import turning_point
from envs.world.referee import GOAL_ASTRAY, GOAL_RADIUS
from marssim.base.dataset.drive_file import LAYERS, DriveFile, depth_of, read_drive
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, json_text
from marssim.base.images.colours import depth_colours

DRIVES = "drives"  # folder of an evaluation with the files of its drives and their pages
FORMAT = 2  # of the data of a page, which one page reads of another
NEAR, FAR = 0.5, 60.0  # [m] depths of the codes 1 and 254 of a page
SCRIPTS = ("pictures.js", "steps.js", "map.js", "costs.js", "drive.js")
SHOWN = tuple(layer for layer in LAYERS if layer != "height")  # the map of a page is flat
ENDINGS = {
    "goal": "It reached the goal", "collision": "It hit an obstacle", "tilt": "It tilted by more than 30 deg",
    "stuck": "It got stuck", "time": "It ran out of time", "out_of_bounds": "It left the ground",
    "no_path": "The driver found no path and gave up",
    "elsewhere": "The driver believed that it was at the goal, but was elsewhere",
}  # fmt: skip


def drive_path(out: Path, episode_file: str) -> Path:
    """Return the file of a drive in the folder of an evaluation; episode_file: that of its episode's record."""
    return out / DRIVES / f"{Path(episode_file).stem}.zip"


def write_drive_pages(folder: Path, again: bool = False) -> tuple[list[Path], list[str]]:
    """Write a page beside each recorded drive that has none yet, or an older one.

    The page of a broken drive is deleted, unless it is younger than the drive, so that it still shows it.

    Args:
        folder: The folder of the drives.
        again: Whether to write all pages.

    Returns:
        The pages of all drives that are whole, and a message on each broken one.
    """
    pages, broken = [], []
    for path in sorted(folder.glob("*.zip")):
        page = path.with_suffix(".html")
        is_older = not page.is_file() or page.stat().st_mtime < path.stat().st_mtime
        if again or is_older:
            try:
                write_atomically(page, drive_page([read_drive(path)]))
            except DatasetError as error:
                if is_older:
                    page.unlink(missing_ok=True)
                broken.append(f"{error}; delete the file, and envs.evaluate --record all records the drive again")
                continue
        pages.append(page)
    return pages, broken


def drive_page(drives: Sequence[DriveFile]) -> bytes:
    """Return the page of one drive, or of two side by side, as HTML.

    Raises:
        DatasetError: A picture of a drive is broken.
    """
    data = {
        "format": FORMAT, "drives": [_shown(drive) for drive in drives], "colours": _colours(),
        "goalRadius": GOAL_RADIUS, "goalAstray": GOAL_ASTRAY, "depthRange": [NEAR, FAR], "outcomes": [*OUTCOME_COLOURS],
    }  # fmt: skip
    return _filled("drive.html", title=" beside ".join(_name(drive) for drive in drives), data=data)


def page_script(data: Any) -> str:
    """Return data as JSON that may stand in a script element: it cannot end the element."""
    return json_text(data).replace("<", "\\u003c")


@cache
def asset(name: str) -> str:
    """Return the text of a file of this package."""
    return files("envs.recording").joinpath(name).read_text(encoding="utf-8")


def _filled(template: str, title: str, data: Any) -> bytes:
    parts = asset(template).split("%%")  # text and names by turns
    values = {
        "title": escape(title), "style": f"{asset('page.css')}\n{colour_rules()}", "data": page_script(data),
        "script": "\n".join(asset(name) for name in SCRIPTS),
    }  # fmt: skip
    return "".join(part if n % 2 == 0 else values[part] for n, part in enumerate(parts)).encode(
        errors="backslashreplace"  # names of files that are no UTF-8
    )


def _name(drive: DriveFile) -> str:
    episode = drive.content["episode"]
    return f"{episode['driver']}, {episode['perception']}: course {episode['episode']}, {episode['cell']}"


def _shown(drive: DriveFile) -> dict[str, Any]:
    """Return what the page shows of a drive."""
    content, episode = drive.content, drive.content["episode"]
    last = drive.steps[-1]
    step, why = turning_point(drive)
    ending = ENDINGS.get(episode["outcome"], f"It ended as {episode['outcome']}")
    gap = "" if episode["outcome"] == "goal" else f", {last['distance']:.1f} m from the goal"
    seconds = episode["steps"] * content["step_seconds"]
    touched = "" if last["contact"] == "none" else f" The rover touched it with {_toucher(last['contact'])}."
    cause = episode.get("cause")
    why_failed = "" if cause is None else f": {IN_WORDS[Cause(cause)]}"
    summary = (
        f"{ending} after {last['way']:.1f} m and {_minutes(seconds)}{gap}{why_failed}. The shortest path is "
        f"{episode['shortest']:.1f} m long.{touched}"
    )
    keys = ("driver", "perception", "cell", "episode", "outcome", "goal", "obstacles", "shortest_path")
    return {
        **{key: episode[key] for key in keys}, "name": _name(drive), "summary": summary, "steps": drive.steps,
        "stepSeconds": content["step_seconds"], "rover": content["rover"], "decided": {"step": step, "why": why},
        "pictures": {layer: [_picture(drive, layer, n) for n in range(len(drive.steps))] for layer in SHOWN},
    }  # fmt: skip


def _toucher(contact: str) -> str:
    return "its chassis" if contact == "chassis" else "a wheel"


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds // 60:.0f} min {seconds % 60:.0f} s"


def _picture(drive: DriveFile, layer: str, step: int) -> str | dict[str, Any] | None:
    """Return an eye's image as a data URI, and a picture of codes as pictures.js takes it; None if there is none.

    The codes of depth have one byte on a page. Of codes, it gets the differences to the row above, modulo 256, which
    zlib compresses better.
    """
    if LAYERS[layer] == "jpg":
        data = drive.picture(layer, step)
        return None if data is None else f"data:image/jpeg;base64,{b64encode(data).decode()}"
    codes = drive.codes(layer, step)
    if codes is None:
        return None
    small = _depth_bytes(depth_of(codes)) if layer == "depth" else codes
    height, width = small.shape
    data = zlib.compress(np.diff(small, axis=0, prepend=np.uint8(0)).tobytes(), 9)
    return {"width": width, "height": height, "deflated": b64encode(data).decode()}


def _depth_bytes(depth: np.ndarray) -> np.ndarray:
    """Return depth (H, W) [m] as uint8: 0 unknown, 1 to 254 from NEAR to FAR on a logarithmic scale, 255 beyond."""
    with np.errstate(invalid="ignore", divide="ignore"):
        code = 1 + 253 * np.log(np.clip(depth, NEAR, FAR) / NEAR) / np.log(FAR / NEAR)
    code = np.where(depth >= FAR, 255, np.nan_to_num(code))
    return np.where(np.isnan(depth), 0, code).round().astype(np.uint8)


def _colours() -> dict[str, list[str]]:
    """Return the colours of the codes of each layer, 256 as #rrggbb."""
    code = np.arange(256)
    depth = NEAR * (FAR / NEAR) ** ((code - 1) / 253)
    depth = np.where(code == 0, np.nan, np.where(code == 255, np.inf, depth))
    layers = {"depth": depth_colours(depth[None])[0], **code_colours()}
    return {name: [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in table.astype(int)] for name, table in layers.items()}
