"""Stereo datasets on disk: their index, their samples, and the encoding of depth and normals."""
