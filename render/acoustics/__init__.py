"""What an array that plays is felt and heard as: pressure at points, force on skin, and audible noise."""
