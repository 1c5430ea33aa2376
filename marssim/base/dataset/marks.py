"""Names of the files that mark a folder as a dataset or as an export of one."""

from __future__ import annotations

SETTINGS = "generate.json"  # marks a dataset of marssim.generate
EXPORTED = "export.json"  # marks an export of marssim.export
