"""Conditions of a drive by name, and versioned lists of episodes that anyone can drive and compare."""
