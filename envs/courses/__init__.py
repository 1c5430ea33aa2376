"""A course: the scene of an episode with its start, goal and shortest path, and the room beside obstacles."""
