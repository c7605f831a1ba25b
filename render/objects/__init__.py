"""What can be touched: solids, at rest or moving; their surfaces and their level of detail."""
