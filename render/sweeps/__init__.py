"""`palpate sweep`: every combination that a plan names, as a table."""
