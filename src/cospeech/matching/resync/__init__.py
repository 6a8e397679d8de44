"""Stage 2: the network that resynchronises k-NN motion with its speech."""
