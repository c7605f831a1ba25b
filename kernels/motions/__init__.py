"""Motions of hands, made where they are used."""
