"""Lens models: where a camera shows a point, and which ray a pixel sees. See lens.py for the conventions."""
