"""Algorithm 1: which eight frames of the database come next."""
