"""Short paths through points that hand and object share."""
