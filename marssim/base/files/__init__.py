"""Readers and writers of single files: JSON, PNG, PFM, .npy."""
