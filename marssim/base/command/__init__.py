"""What all commands share: parsing, messages, progress, signals and exit codes."""
