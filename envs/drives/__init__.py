"""Series of drives: episodes, records, metrics, report and figures."""
