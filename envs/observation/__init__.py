"""What MarsNav-v0 shows an agent."""
