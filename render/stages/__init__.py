"""Prune and transform stages of intersection strategies; add yours here."""
