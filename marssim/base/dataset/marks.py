"""The files by which the folders of datasets and of their exports are known."""

from __future__ import annotations

SETTINGS = "generate.json"
EXPORTED = "export.json"  # of a folder that marssim.export has written
