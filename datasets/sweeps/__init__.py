"""What a sweep keeps: its store, the shards of its tasks, its table."""
