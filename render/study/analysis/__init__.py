"""The analysis of a study: its answers as tables, tests, fits and figures, and the report that has them."""
