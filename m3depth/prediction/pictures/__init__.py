"""Pictures of predictions: of one pair, of its refinement steps, and of all pairs in a sheet, a video and a cloud."""
