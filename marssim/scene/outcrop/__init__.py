"""What stands out of the ground besides the rocks of Golombek's law: slabs of bedrock, ledges and fragments."""
