"""How a sweep is run: what its store lacks, the schedule, and the engines whose workers make tasks."""
