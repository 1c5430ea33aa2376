"""The world of MarsNav-v0: vehicle, perception and referee."""
