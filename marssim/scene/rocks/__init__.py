"""The rocks of a scene: the law of their sizes, their places, their shapes, and their mesh."""
