"""Generators: speech in, motion out. chapter4 learns one speaker, ha2g many; the baselines are held against both."""
