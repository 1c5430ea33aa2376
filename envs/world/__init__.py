"""The world of MarsNav-v0: course, vehicle, perception and referee."""
