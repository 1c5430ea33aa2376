"""The parts of the command marssim.generate: its configuration, its tasks, and the contact sheet."""
