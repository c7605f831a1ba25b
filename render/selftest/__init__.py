"""`palpate selftest`: stimuli that a hand should feel, and a person's first hour with a board."""
