"""What HA2G and its baselines learn from: many speakers' takes as unit bone vectors, words and sound, filtered."""
