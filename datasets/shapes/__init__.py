"""The paper's objects, made by code."""
