"""What a worker of a sweep does with a task: renders chunks, measures them, keeps files."""
