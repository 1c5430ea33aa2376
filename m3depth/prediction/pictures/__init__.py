"""Pictures of a prediction: its maps side by side, and its refinement steps."""
