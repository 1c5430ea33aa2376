"""Checks, statistics and figures of datasets, and comparisons of renderers."""
