"""`palpate view`: what was rendered, in a browser: live, or as one page to mail."""
