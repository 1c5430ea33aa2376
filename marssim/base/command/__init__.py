"""What every command does with its command line, its messages and its end."""
