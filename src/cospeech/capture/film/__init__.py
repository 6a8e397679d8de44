"""Films: lists of takes and where to get them, decoding, shots, and what was seen drawn over the picture."""
