"""The joints of a hand, and the project's own hand mesh around them."""
