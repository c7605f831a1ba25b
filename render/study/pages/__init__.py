"""What participants and experimenters see in the browser."""
