"""Running a sweep: what its store lacks, units of it, and the executors that make them."""
