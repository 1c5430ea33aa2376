"""Scores of methods on pairs without true depth: agreement of the eyes, photometric residual, sky and unknown."""
