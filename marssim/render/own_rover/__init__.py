"""The rover that carries the cameras, where it is in view or casts its shadow."""
