"""The runs, tables and figure of the ablation study."""
