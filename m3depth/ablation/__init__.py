"""The studies, runs, tables and figures of the ablation."""
