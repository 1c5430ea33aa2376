"""The figures of an evaluation and of a texture analysis."""
