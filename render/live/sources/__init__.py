"""Live poses: trackers and recordings, each read in a process of its own, which sends one message for each pose."""
