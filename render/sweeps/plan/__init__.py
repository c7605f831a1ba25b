"""What a sweep is to make: PLAN.toml, its axes, and the recipes that they stand for."""
