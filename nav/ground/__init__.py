"""The map of the ground: elevation and traversability."""
