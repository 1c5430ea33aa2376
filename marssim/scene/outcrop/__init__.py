"""What stands out of the ground besides the rocks of Golombek's law: slabs of bedrock with beds on them, chips around
them, ledges and fragments."""
