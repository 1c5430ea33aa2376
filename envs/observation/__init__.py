"""The observations of MarsNav-v0."""
