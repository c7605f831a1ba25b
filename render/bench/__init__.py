"""`palpate bench`: palpate beside published libraries on the same poses."""
