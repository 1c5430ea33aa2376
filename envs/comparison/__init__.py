"""Results of a suite by several laboratories: a schema, a check, and a comparison with paired intervals."""
