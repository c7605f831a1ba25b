"""Arrays of transducers and how to play frames to them. Never imports Warp."""
