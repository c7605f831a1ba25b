"""A writer that is paced by deadlines, in a process of its own: what is late is skipped, and lag does not grow."""
