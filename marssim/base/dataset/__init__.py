"""Stereo datasets on disk: writing, reading and encoding of samples."""
