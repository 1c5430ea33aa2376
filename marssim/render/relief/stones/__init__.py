"""The stones of 5 to 80 mm on the ground: their bodies, what rays meet of them, and how high they reach."""
