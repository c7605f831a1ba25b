"""Object, hand and strategy -> contours of a batch of poses."""
