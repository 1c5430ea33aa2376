"""The renderers that fill a G-buffer: PyBullet, Embree and scan conversion."""
