"""Ultraleap's STRATOS Explore through the vendor's library, which the program `palpate-ultraleap` is linked with."""
