"""Fuzzing of every reader of files: valid files, changed at random, in a child process with limits."""
