"""Series of drives: episodes, their records, metrics, report and figures."""
