"""What each pixel sees: meshes, projection, hits and visibility."""
