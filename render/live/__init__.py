"""A hand that moves now: from its tracker to an array, with a stated latency."""
