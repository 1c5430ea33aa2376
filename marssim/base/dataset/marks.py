"""Names of the files that mark a folder as a dataset or as an export of one."""

from __future__ import annotations

SETTINGS = "generate.json"  # marks a dataset of marssim.generate
SOURCES = "sources"  # its key of the digests of marssim's source files that rendered pairs
MARK_NOTES = ("command", SOURCES)  # its keys that may differ from run to run
EXPORTED = "export.json"  # marks an export of marssim.export
