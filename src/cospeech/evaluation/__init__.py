"""How good is a motion: the field's metrics, their feature network, and the tables they end in."""
