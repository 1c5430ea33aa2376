"""Paths over the map: search, footprint and distances."""
