"""What the command marssim.generate is made of."""
