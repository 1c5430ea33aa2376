"""The right image that belongs to a left one, by the names that missions give their products.

Mars 2020 and MSL: the first letter is the camera (N Navcam, F front Hazcam, R rear Hazcam, Z Mastcam-Z), the second the
eye, L or R. Then come the filter, the sol, the clock and the kind of product. What follows (version, compression) may
differ between the eyes.
"""

from __future__ import annotations

import re
from glob import escape
from pathlib import Path

SUFFIXES = (".img", ".vic", ".red", ".lbl", ".xml")  # of products, and of their detached labels

# camera, eye, the rest up to the kind of product, the rest
M2020 = re.compile(r"([NFRZS])(L)([A-Z0-9_]{2}\d{4}_\d{10}_\d{3}[A-Z]{3}_)(.*)")
MSL = re.compile(r"([NFR])(L)([AB]_\d{9}[A-Z]{3}_)(.*)")


def is_product(path: Path) -> bool:
    """Return whether a file is a product of a mission by the end of its name."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def label_beside(path: Path) -> Path | None:
    """Return the label in a file of its own beside a product; None if there is none."""
    others = (file for file in path.parent.glob(f"{escape(path.stem)}.*") if file.suffix.lower() in (".lbl", ".xml"))
    return next((file for file in sorted(others) if file != path), None)


def left_products(folder: Path) -> list[Path]:
    """Return the files of a folder that are left images by their names, in the order of their names."""
    return sorted(file for file in folder.iterdir() if M2020.fullmatch(file.name) or MSL.fullmatch(file.name))


def right_of(left: Path) -> Path:
    """Return the right image of a left one, in the same folder.

    Args:
        left: The left image, with a name of Mars 2020 or of MSL.

    Raises:
        FileNotFoundError: There is no right image, or the name is of no known mission. One line.
        ValueError: There are several.
    """
    match = M2020.fullmatch(left.name) or MSL.fullmatch(left.name)
    if match is None:
        raise FileNotFoundError(
            f"{left}: give the right image too; only names of left images of Mars 2020 and MSL tell it"
        )
    camera, _, middle, rest = match.groups()
    same = left.with_name(f"{camera}R{middle}{rest}")
    if same.is_file():
        return same
    suffix = left.suffix.lower()
    start = f"{camera}R{middle}"
    others = sorted(
        file for file in left.parent.iterdir() if file.name.startswith(start) and file.suffix.lower() == suffix
    )
    if not others:
        raise FileNotFoundError(f"{same}: the right image of {left.name} is missing; put it there, or give both")
    if len(others) > 1:
        raise ValueError(f"{left}: several right images belong to it ({others[0].name}, {others[1].name}): give one")
    return others[0]
