"""Stereo pairs, predictions and classical matching."""
