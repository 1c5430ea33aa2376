"""Scores of predicted depth and normals, and their report."""
