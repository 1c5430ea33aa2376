"""A course: the scene of an episode with its start, goal and shortest way, and the room beside obstacles."""
