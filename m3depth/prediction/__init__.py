"""Prediction on image files: checks, files and figure."""
