"""`palpate reproduce`: the founding paper's evaluation, made again and put beside the paper's own numbers."""
