"""Prediction on image files: checks of the pair, the files that are written, and the figure."""
