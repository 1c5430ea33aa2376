"""The training loop with its data, losses and logs."""
