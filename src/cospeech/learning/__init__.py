"""How networks are trained and kept: the loop, its settings, windows, weights, and what several networks share."""
