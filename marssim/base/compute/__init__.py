"""Worker processes, threads and compiled loops."""
