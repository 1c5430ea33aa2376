"""Wheels on soil: what carries and drives them, how far they sink, and how much of their way they lose."""
