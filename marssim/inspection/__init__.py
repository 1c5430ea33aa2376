"""Checks, statistics and figures of datasets and renderers."""
