"""Generators of thesis chapter 4: speech features in, motion of body, hands and face out."""
