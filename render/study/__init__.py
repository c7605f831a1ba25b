"""`palpate study`: from a plan to the last answer of a participant."""
