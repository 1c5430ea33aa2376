"""Where the pairs of a prediction come from: image files, patterns, datasets, lists, videos; calibrations and poses."""
