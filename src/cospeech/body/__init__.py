"""The body: what of a speaker keeps its size and shape, and what is taken for granted where nothing was recorded."""
