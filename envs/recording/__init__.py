"""Recorded drives, step by step, and the pages that show them."""
