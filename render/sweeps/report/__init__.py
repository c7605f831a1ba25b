"""What a sweep leaves for people: the table, its figure, and the comparison with an earlier one."""
